# quell_add_module_tests(<module folder> LABEL <label> LINK <targets...> SOURCES <files...>)
#   One GoogleTest program per module, build/bin/quell<Folder>Tests; every test becomes a ctest test
#   quell::<folder>/<Suite>.<Name> with the label. QUELL_SOURCE_DIR and QUELL_SHARED_DATA (the neighbouring shared/data,
#   which may not exist: skip then) are defined.
include(GoogleTest)

# Where tests write: two builds of one machine do not meet.
set(quell_test_directory "${CMAKE_BINARY_DIR}/Testing/Temporary/files")
file(MAKE_DIRECTORY "${quell_test_directory}")

# quell_label_test(<name> <label> <seconds>): for tests made by add_test. Sanitizers take their time.
function (quell_label_test name label timeout)
  if (QUELL_SANITIZER)
    math(EXPR timeout "${timeout} * 10")
  endif ()
  set_tests_properties("${name}" PROPERTIES LABELS ${label} TIMEOUT ${timeout})
  set_property(TEST "${name}" APPEND PROPERTY ENVIRONMENT "TEST_TMPDIR=${quell_test_directory}")
endfunction ()

function (quell_add_module_tests folder)
  cmake_parse_arguments(arg "" "LABEL;TIMEOUT" "LINK;SOURCES" ${ARGN})
  if (NOT arg_SOURCES)
    message(WARNING "module ${folder} has no tests")
    return ()
  endif ()
  set(target "quell${folder}Tests")
  add_executable(${target} ${arg_SOURCES})
  target_link_libraries(${target} PRIVATE ${arg_LINK} TBB::tbb GTest::gtest GTest::gtest_main)
  target_include_directories(${target} PRIVATE "${PROJECT_SOURCE_DIR}/Testing")
  target_compile_options(${target} PRIVATE ${quell_compile_options})
  target_compile_definitions(${target} PRIVATE
    QUELL_SOURCE_DIR="${PROJECT_SOURCE_DIR}"
    QUELL_SHARED_DATA="${PROJECT_SOURCE_DIR}/../shared/data")
  if (NOT arg_TIMEOUT)
    set(arg_TIMEOUT 120)
  endif ()
  if (QUELL_SANITIZER)
    math(EXPR arg_TIMEOUT "${arg_TIMEOUT} * 10")
  endif ()
  gtest_discover_tests(${target} TEST_PREFIX "quell::${folder}/" DISCOVERY_TIMEOUT 60
    PROPERTIES LABELS "${arg_LABEL}" TIMEOUT ${arg_TIMEOUT} ENVIRONMENT "TEST_TMPDIR=${quell_test_directory}")
endfunction ()
