# Included by the scripts that drive the program: PROGRAM and WORK are given. Begins with an empty WORK.
file(REMOVE_RECURSE "${WORK}")
file(MAKE_DIRECTORY "${WORK}")

# quell(<status> <text that stderr or stdout holds> args...)
function (quell status text)
  execute_process(COMMAND "${PROGRAM}" ${ARGN} WORKING_DIRECTORY "${WORK}"
    RESULT_VARIABLE result OUTPUT_VARIABLE out ERROR_VARIABLE err)
  set(said "${out}${err}")
  string(FIND "${said}" "${text}" at)
  if (NOT "${result}" STREQUAL "${status}" OR at EQUAL -1)
    message(FATAL_ERROR "quell ${ARGN}\nexpected status ${status} and \"${text}\"\nstatus ${result}\n${said}")
  endif ()
  set(said "${said}" PARENT_SCOPE)
endfunction ()

# expect(<what is wrong otherwise> condition...)
function (expect what)
  if (NOT (${ARGN}))
    message(FATAL_ERROR "${what}")
  endif ()
endfunction ()

# Two images are the same in every bit of every pixel.
function (same a b)
  quell(0 "relMSE" compare ${a} ${b} --metric relMSE --max relMSE=0)
endfunction ()
