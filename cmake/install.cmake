# What `cmake --install` puts where: programs, what they load, texts and examples of configurations; and the renderer as a library
# (find_package(gobo), gobo::renderer) with its headers below include/gobo. Manual page, completions, Python: clients/CMakeLists.txt. Components are packages
# (cmake/package.cmake): gobo (CMAKE_INSTALL_DEFAULT_COMPONENT_NAME), python and dev.
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)

install(TARGETS gobod gobo-ingest)
install(DIRECTORY configs/ DESTINATION share/gobo/configs)
install(DIRECTORY deploy/front DESTINATION share/gobo USE_SOURCE_PERMISSIONS)
install(DIRECTORY docs/ DESTINATION share/doc/gobo FILES_MATCHING PATTERN "*.md" PATTERN api EXCLUDE PATTERN images EXCLUDE)
install(FILES README.md SECURITY.md CHANGELOG.md LICENSE DESTINATION share/doc/gobo)
install(DIRECTORY examples DESTINATION share/doc/gobo)
install(DIRECTORY proto/gobo DESTINATION share/gobo/proto FILES_MATCHING PATTERN "*.proto")
configure_file(deploy/gobod.service ${CMAKE_BINARY_DIR}/gobod.service COPYONLY)
install(FILES ${CMAKE_BINARY_DIR}/gobod.service DESTINATION lib/systemd/system)
install(FILES deploy/gobo.sysusers DESTINATION lib/sysusers.d RENAME gobo.conf)
install(FILES deploy/gobo.tmpfiles DESTINATION lib/tmpfiles.d RENAME gobo.conf)

add_library(gobo_renderer INTERFACE)
target_link_libraries(gobo_renderer INTERFACE gobo_plan gobo_import)
# Programs elsewhere find what reads picture formats and OpenColorIO configs by their search path (renderer/base/shared_object.cpp).
target_link_options(gobo_renderer INTERFACE $<INSTALL_INTERFACE:-Wl,-rpath,$<INSTALL_PREFIX>/lib/gobo>)
target_compile_features(gobo_renderer INTERFACE cxx_std_20)
set_target_properties(gobo_renderer PROPERTIES EXPORT_NAME renderer)
set(layers gobo_base gobo_formulas gobo_scene gobo_import gobo_trace gobo_device gobo_terms gobo_filters gobo_request gobo_technique gobo_techniques gobo_measure gobo_plan)
target_include_directories(gobo_base INTERFACE $<INSTALL_INTERFACE:include> $<INSTALL_INTERFACE:include/gobo>)   # layers name each other's headers from there
target_include_directories(gobo_formulas INTERFACE $<INSTALL_INTERFACE:include/gobo>)
target_include_directories(gobo_proto INTERFACE $<INSTALL_INTERFACE:include/gobo>)
install(TARGETS gobo_renderer ${layers} gobo_proto EXPORT gobo-targets ARCHIVE DESTINATION lib/gobo COMPONENT dev)
install(EXPORT gobo-targets NAMESPACE gobo:: DESTINATION lib/cmake/gobo COMPONENT dev)
install(DIRECTORY renderer/ DESTINATION include/gobo COMPONENT dev FILES_MATCHING PATTERN "*.h" PATTERN codec EXCLUDE PATTERN color EXCLUDE PATTERN "*_data.h" EXCLUDE)
install(DIRECTORY ${CMAKE_BINARY_DIR}/proto/gobo DESTINATION include/gobo COMPONENT dev FILES_MATCHING PATTERN "*.pb.h" PATTERN "*.grpc.pb.h" EXCLUDE)
write_basic_package_version_file(${CMAKE_BINARY_DIR}/gobo-config-version.cmake COMPATIBILITY SameMinorVersion)
install(FILES cmake/gobo-config.cmake ${CMAKE_BINARY_DIR}/gobo-config-version.cmake DESTINATION lib/cmake/gobo COMPONENT dev)
