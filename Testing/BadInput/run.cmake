# cmake -DPROGRAM=quell -DNAME=... -DFILES=dir -P run.cmake: `quell check NAME.xml` must say exactly NAME.txt on stderr and
# end with status 2, or with 0 where there are only warnings.
execute_process(
  COMMAND "${PROGRAM}" check "${NAME}.xml"
  WORKING_DIRECTORY "${FILES}"
  RESULT_VARIABLE status OUTPUT_VARIABLE out ERROR_VARIABLE err)
if (DEFINED ENV{QUELL_UPDATE_GOLDEN})
  file(WRITE "${FILES}/${NAME}.txt" "${err}")
endif ()
file(READ "${FILES}/${NAME}.txt" expected)
if (NOT "${err}" STREQUAL "${expected}")
  message(FATAL_ERROR "expected:\n${expected}\ngot (status ${status}):\n${err}")
endif ()
set(wanted 0)
if ("${expected}" MATCHES ": error: ")
  set(wanted 2)
endif ()
if (NOT "${status}" STREQUAL "${wanted}")
  message(FATAL_ERROR "exit status ${status}, expected ${wanted}\n${err}")
endif ()
