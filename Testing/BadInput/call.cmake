# Runs `quell ARGS` in a fresh folder WORK; FILES@ in the arguments stands for this folder. Checks the exit status and that
# stderr holds TEXT, and that nothing was written.
file(REMOVE_RECURSE "${WORK}")
file(MAKE_DIRECTORY "${WORK}")
string(REPLACE "FILES@" "${FILES}/" ARGS "${ARGS}")
execute_process(
  COMMAND "${PROGRAM}" ${ARGS}
  WORKING_DIRECTORY "${WORK}"
  RESULT_VARIABLE status OUTPUT_VARIABLE out ERROR_VARIABLE err)
string(FIND "${err}" "${TEXT}" at)
if (NOT "${status}" STREQUAL "${STATUS}" OR at EQUAL -1)
  message(FATAL_ERROR "expected status ${STATUS} and \"${TEXT}\"\nstatus ${status}\n--- stdout\n${out}\n--- stderr\n${err}")
endif ()
file(GLOB_RECURSE written "${WORK}/*")
if (written)
  message(FATAL_ERROR "left behind: ${written}")
endif ()
