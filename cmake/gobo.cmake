# Layers are static libraries made of all sources of a folder; linking encodes the dependency rule of docs/architecture.md.
function(gobo_layer name)
  file(GLOB_RECURSE sources CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/${name}/*.cpp)
  add_library(gobo_${name} STATIC ${sources})
  target_include_directories(gobo_${name} PUBLIC ${CMAKE_SOURCE_DIR}/renderer)
  target_link_libraries(gobo_${name} PUBLIC ${ARGN})
endfunction()

# One test program per folder under tests/<tier>/<name>, labelled by tier; every test is its own ctest entry.
function(gobo_test_folder tier name)
  file(GLOB sources CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/${tier}/${name}/*_test.cpp)
  if(NOT sources)
    return()
  endif()
  set(target test_${tier}_${name})
  add_executable(${target} ${sources})
  target_include_directories(${target} PRIVATE ${CMAKE_SOURCE_DIR}/tests)
  target_link_libraries(${target} PRIVATE ${ARGN} GTest::gtest_main)
  include(GoogleTest)
  gtest_discover_tests(${target} TEST_PREFIX ${tier}.${name}. DISCOVERY_MODE PRE_TEST
    PROPERTIES LABELS ${tier} TIMEOUT 600 WORKING_DIRECTORY ${CMAKE_SOURCE_DIR})
endfunction()

function(gobo_version)
  execute_process(COMMAND git -C ${CMAKE_SOURCE_DIR} describe --always --dirty OUTPUT_VARIABLE described
    OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
  set(GOBO_BUILD "${PROJECT_VERSION}+${described}" PARENT_SCOPE)
endfunction()
