# Compiles one GLSL file to SPIR-V as a C initialiser list, with its includes followed.
function(gobo_spirv source output)
  add_custom_command(OUTPUT ${output}
    COMMAND ${GLSLC} --target-env=vulkan1.1 -O -Werror -I ${CMAKE_SOURCE_DIR}/renderer -MD -MF ${output}.d -mfmt=c -o ${output} ${source}
    DEPENDS ${source} DEPFILE ${output}.d VERBATIM)
endfunction()

# The same file for OpenGL: preprocessed GLSL as a C++ string, once glslc has found it valid there.
function(gobo_glsl source output)
  set(flags -DGOBO_OPENGL -I ${CMAKE_SOURCE_DIR}/renderer)
  add_custom_command(OUTPUT ${output}
    COMMAND ${GLSLC} --target-env=opengl4.5 -Werror ${flags} -o ${output}.check ${source}
    COMMAND ${GLSLC} -E ${flags} -MD -MF ${output}.d -MT ${output} -o ${output}.glsl ${source}
    COMMAND ${CMAKE_COMMAND} -DIN=${output}.glsl -DOUT=${output} -P ${CMAKE_SOURCE_DIR}/cmake/glsl_text.cmake
    DEPENDS ${source} ${CMAKE_SOURCE_DIR}/cmake/glsl_text.cmake DEPFILE ${output}.d VERBATIM)
endfunction()

# Every formulas/*.glsl.h must be valid GLSL: each is compiled alone, in every build.
function(gobo_check_formulas)
  file(GLOB formulas CONFIGURE_DEPENDS ${CMAKE_SOURCE_DIR}/renderer/formulas/*.glsl.h)
  set(outputs)
  foreach(formula ${formulas})
    get_filename_component(file ${formula} NAME)
    set(wrapper ${CMAKE_CURRENT_BINARY_DIR}/formulas/${file}.comp)
    file(CONFIGURE OUTPUT ${wrapper} CONTENT "#version 450
#extension GL_GOOGLE_include_directive : require
#include \"formulas/${file}\"
layout(local_size_x = 1) in;
void main() {}
" @ONLY)
    gobo_spirv(${wrapper} ${wrapper}.inc)
    list(APPEND outputs ${wrapper}.inc)
  endforeach()
  add_custom_target(gobo_formulas_glsl ALL DEPENDS ${outputs})
endfunction()

# *.comp below `folder` become SPIR-V and OpenGL's text, which the C++ of `target` includes as "shaders/<name>.inc" and
# "shaders/<name>.glsl.inc".
function(gobo_shaders target folder)
  file(GLOB_RECURSE shaders CONFIGURE_DEPENDS ${folder}/*.comp)
  set(root ${CMAKE_CURRENT_BINARY_DIR}/shaders/${target})
  foreach(shader ${shaders})
    get_filename_component(file ${shader} NAME_WE)
    gobo_spirv(${shader} ${root}/shaders/${file}.inc)
    gobo_glsl(${shader} ${root}/shaders/${file}.glsl.inc)
    target_sources(${target} PRIVATE ${root}/shaders/${file}.inc ${root}/shaders/${file}.glsl.inc)
  endforeach()
  target_include_directories(${target} PRIVATE ${root})
endfunction()

# Layers are static libraries made of all sources of a folder; linking encodes the dependency rule of docs/architecture.md.
# *_kernels.cpp hold loops that must vectorise: -O3 (GCC's -O2 vectorises known trip counts only); neither flag changes a
# value.
function(gobo_layer name)
  file(GLOB_RECURSE sources CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/${name}/*.cpp)
  foreach(source ${sources})
    if(source MATCHES "_kernels\\.cpp$")
      set_source_files_properties(${source} PROPERTIES COMPILE_OPTIONS "-O3;-fno-trapping-math" SKIP_PRECOMPILE_HEADERS ON)
    elseif(source MATCHES "/technique\\.cpp$")   # every family calls its functions alike
      set_source_files_properties(${source} PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON)
    endif()
  endforeach()
  add_library(gobo_${name} STATIC ${sources})
  gobo_shaders(gobo_${name} ${CMAKE_CURRENT_SOURCE_DIR}/${name})
  target_include_directories(gobo_${name} PUBLIC $<BUILD_INTERFACE:${CMAKE_SOURCE_DIR}/renderer>)
  target_link_libraries(gobo_${name} PUBLIC ${ARGN})
  gobo_precompiled(gobo_${name} ${ARGN})
endfunction()

# The picture formats, loaded when they are needed (renderer/base/image_codec.h), which knows where.
function(gobo_image_codec)
  add_library(gobo_image_codec MODULE ${CMAKE_CURRENT_SOURCE_DIR}/codec/image_codec.cpp ${CMAKE_CURRENT_SOURCE_DIR}/codec/webp.cpp
    ${CMAKE_CURRENT_SOURCE_DIR}/base/status.cpp)
  target_include_directories(gobo_image_codec PRIVATE ${CMAKE_SOURCE_DIR}/renderer)
  target_link_libraries(gobo_image_codec PRIVATE PkgConfig::OpenImageIO PkgConfig::webp)
  set_target_properties(gobo_image_codec PROPERTIES CXX_VISIBILITY_PRESET hidden UNITY_BUILD OFF)
  install(TARGETS gobo_image_codec DESTINATION lib/gobo)
  add_dependencies(gobo_base gobo_image_codec)
endfunction()

# OpenColorIO, loaded when a config is (renderer/base/color_config.h).
function(gobo_color)
  add_library(gobo_color MODULE ${CMAKE_CURRENT_SOURCE_DIR}/color/ocio_config.cpp ${CMAKE_CURRENT_SOURCE_DIR}/color/files_of_config.cpp
    ${CMAKE_CURRENT_SOURCE_DIR}/base/status.cpp ${CMAKE_CURRENT_SOURCE_DIR}/base/hash.cpp)
  target_include_directories(gobo_color PRIVATE ${CMAKE_SOURCE_DIR}/renderer)
  target_link_libraries(gobo_color PRIVATE PkgConfig::OpenColorIO)
  set_target_properties(gobo_color PROPERTIES CXX_VISIBILITY_PRESET hidden UNITY_BUILD OFF)
  install(TARGETS gobo_color DESTINATION lib/gobo)
  add_dependencies(gobo_base gobo_color)
endfunction()

# Precompiled headers: half of a compilation is reading the same headers again. cmake/pch/HEADER.h, compiled once for all targets that may
# include it and are optimised alike: only definitions that the headers themselves read must be the same.
function(gobo_precompiled_with target header library)   # and further options, of both
  string(REPLACE "-" "_" holder "gobo_pch_${header}${ARGN}")
  if(NOT TARGET ${holder})
    set(empty ${CMAKE_BINARY_DIR}/pch/${holder}.cpp)
    file(CONFIGURE OUTPUT ${empty} CONTENT "")
    add_library(${holder} OBJECT ${empty})
    target_include_directories(${holder} PRIVATE ${CMAKE_SOURCE_DIR}/cmake ${CMAKE_SOURCE_DIR}/renderer)
    target_link_libraries(${holder} PRIVATE ${library})
    target_compile_options(${holder} PRIVATE ${ARGN})
    target_precompile_headers(${holder} PRIVATE ${CMAKE_SOURCE_DIR}/cmake/pch/${header}.h)
  endif()
  target_include_directories(${target} PRIVATE ${CMAKE_SOURCE_DIR}/cmake)
  target_compile_options(${target} PRIVATE ${ARGN})
  target_precompile_headers(${target} REUSE_FROM ${holder})
endfunction()

# In checked builds (GOBO_PLANNING is -O0 there) only what computes pictures is optimised: what decides, reads and waits is compiled in two thirds of the
# time without, and its tests take as long as before.
function(gobo_precompiled target)
  if(target STREQUAL gobo_import)
    gobo_precompiled_with(${target} json tinygltf)   # reading large files is most of what its tests do
  elseif(target MATCHES "^gobo_(terms|filters)$")
    gobo_precompiled_with(${target} messages gobo_proto)
  elseif(target MATCHES "^gobo_(request|technique|techniques|plan|fuzz_properties)$")
    gobo_precompiled_with(${target} messages gobo_proto ${GOBO_PLANNING})
  elseif(target MATCHES "^(gobo_server|gobo|gobo_regress|gobo_measurement|gobo_fuzz_served)$")
    gobo_precompiled_with(${target} calls gobo_grpc ${GOBO_PLANNING})
  else()
    gobo_precompiled_with(${target} standard Threads::Threads)
  endif()
endfunction()

function(gobo_precompiled_tests target)
  if("gobo_server" IN_LIST ARGN OR "gobo_fuzz_served" IN_LIST ARGN)   # what links gRPC is compiled with -pthread
    gobo_precompiled_with(${target} test_calls "gobo_grpc;GTest::gtest_main" ${GOBO_WAITING_TESTS})
  elseif(target MATCHES "^test_unit_(scene|trace|base|device|measure)$")
    gobo_precompiled_with(${target} test GTest::gtest_main ${GOBO_ENGINE_TESTS})
  else()
    gobo_precompiled_with(${target} test_messages "gobo_proto;GTest::gtest_main" ${GOBO_ENGINE_TESTS})
  endif()
endfunction()

# Suites of a folder's sources that may skip a test, which ctest can only tell of an entry as a whole: those have an entry a test.
# Where a header skips, so may every suite that includes it.
function(gobo_suites_that_skip result folder)
  set(suites)
  set(skipping "GTEST_SKIP")
  file(GLOB headers ${folder}/*.h)
  foreach(header ${headers})
    file(READ ${header} text)
    if(text MATCHES "GTEST_SKIP")
      get_filename_component(file ${header} NAME)
      string(APPEND skipping "|/${file}\"")
    endif()
  endforeach()
  foreach(source ${ARGN})
    file(READ ${source} text)
    if(text MATCHES "${skipping}")
      string(REGEX MATCHALL "TEST(_F|_P)?\\([A-Za-z0-9_]+" tests "${text}")
      list(TRANSFORM tests REPLACE "^.*\\(" "")
      list(APPEND suites ${tests})
    endif()
  endforeach()
  list(REMOVE_DUPLICATES suites)
  set(${result} ${suites} PARENT_SCOPE)
endfunction()

# One test program per folder under tests/<tier>/<name>, labelled by tier; every suite is its own ctest entry (test_entries.cmake).
function(gobo_test_folder tier name)
  set(folder ${CMAKE_CURRENT_SOURCE_DIR}/${tier}/${name})
  file(GLOB sources CONFIGURE_DEPENDS ${folder}/*_test.cpp ${folder}/*/*.cpp)
  if(NOT sources)
    return()
  endif()
  set(target test_${tier}_${name})
  add_executable(${target} ${sources})
  target_include_directories(${target} PRIVATE ${CMAKE_SOURCE_DIR}/tests)
  gobo_shaders(${target} ${folder})
  set(reads gobo_import)   # tests read files in their own process
  if(target MATCHES "^test_unit_(base|device|measure)$")
    set(reads "")
  endif()
  target_link_libraries(${target} PRIVATE ${ARGN} ${reads} GTest::gtest_main)
  gobo_precompiled_tests(${target} ${ARGN})
  gobo_suites_that_skip(single ${folder} ${sources})
  gobo_test_costs(costs)
  list(FILTER costs INCLUDE REGEX "^${tier}\\.${name}\\.")
  set(asks ${CMAKE_CURRENT_BINARY_DIR}/${target}_entries.cmake)
  file(GENERATE OUTPUT ${asks} CONTENT "set(GOBO_PROGRAM [=[$<TARGET_FILE:${target}>]=])
set(GOBO_PREFIX ${tier}.${name}.)
set(GOBO_LABEL ${tier})
set(GOBO_FOLDER [=[${CMAKE_SOURCE_DIR}]=])
set(GOBO_SINGLE [=[${single}]=])
set(GOBO_COSTS [=[${costs}]=])
set(GOBO_ASKED_BY [=[${asks}]=])
set(GOBO_ANSWER [=[${CMAKE_CURRENT_BINARY_DIR}/${target}_suites.cmake]=])
include([=[${CMAKE_SOURCE_DIR}/cmake/test_entries.cmake]=])
")
  set_property(DIRECTORY APPEND PROPERTY TEST_INCLUDE_FILES ${asks})
endfunction()

# tests/costs.txt: seconds of the dearest entries, which begin first then. Where a line is old or missing the order is worse and nothing else.
function(gobo_test_costs result)
  set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/costs.txt)
  file(STRINGS ${CMAKE_CURRENT_SOURCE_DIR}/costs.txt costs REGEX "^[a-z]")
  set(${result} ${costs} PARENT_SCOPE)
endfunction()

function(gobo_version)
  execute_process(COMMAND git -C ${CMAKE_SOURCE_DIR} describe --always --dirty OUTPUT_VARIABLE described
    OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
  set(GOBO_BUILD "${PROJECT_VERSION}+${described}" PARENT_SCOPE)
endfunction()
