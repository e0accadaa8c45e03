# Debian packages of what cmake/install.cmake installs (`make deb`; docs/operations.md, "As a Debian package"): gobo (programs, texts, the systemd unit), python3-gobo
# (the client) and gobo-dev (find_package(gobo)). What a package has beside installed files (configuration, user, folders, copyright) comes from deploy/debian,
# by cmake/package_root.cmake.
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME gobo)
set(CPACK_PACKAGE_VERSION ${PROJECT_VERSION})
set(CPACK_PACKAGE_VENDOR Gobo)
set(CPACK_PACKAGE_DIRECTORY ${CMAKE_BINARY_DIR}/packages)
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_INSTALL_DEFAULT_DIRECTORY_PERMISSIONS OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE WORLD_READ WORLD_EXECUTE)
set(CPACK_COMPONENTS_ALL gobo python dev)
set(CPACK_COMPONENTS_GROUPING IGNORE)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_PRE_BUILD_SCRIPTS ${CMAKE_SOURCE_DIR}/cmake/package_root.cmake)
set(CPACK_GOBO_DEBIAN ${CMAKE_SOURCE_DIR}/deploy/debian)

set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_RELEASE 1)
set(CPACK_DEBIAN_PACKAGE_MAINTAINER "The Gobo authors <gobo@localhost>")
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
set(CPACK_DEBIAN_COMPRESSION_TYPE xz)

set(CPACK_DEBIAN_GOBO_PACKAGE_NAME gobo)
set(CPACK_DEBIAN_GOBO_PACKAGE_SECTION graphics)
# What is not linked (what is, cmake/package_root.cmake finds): who makes the user and the folders; drivers are loaded where there are some, ca-certificates is read for `gobo --tls`.
set(CPACK_DEBIAN_GOBO_PACKAGE_DEPENDS "systemd | systemd-standalone-sysusers, systemd | systemd-standalone-tmpfiles")
set(CPACK_DEBIAN_GOBO_PACKAGE_RECOMMENDS "mesa-vulkan-drivers | vulkan-icd, libgl1-mesa-dri, libegl1, ca-certificates")
set(CPACK_DEBIAN_GOBO_PACKAGE_SUGGESTS "python3-gobo, nginx-light")
set(CPACK_DEBIAN_GOBO_PACKAGE_CONTROL_EXTRA "")
foreach(file conffiles postinst prerm postrm)
  list(APPEND CPACK_DEBIAN_GOBO_PACKAGE_CONTROL_EXTRA ${CMAKE_SOURCE_DIR}/deploy/debian/gobo/${file})
endforeach()
set(CPACK_COMPONENT_GOBO_DESCRIPTION "rendering server that relights what it has rendered
gobod renders scenes (glTF 2.0) on request and keeps the terms that a picture
is made of, so that another light, material or view costs what has changed.
gobo is its command line. The daemon runs as a user of its own and listens on
/run/gobo/gobo.sock for members of the group gobo. The processor must have AVX2
(x86-64-v3).")

set(CPACK_DEBIAN_PYTHON_PACKAGE_NAME python3-gobo)
set(CPACK_DEBIAN_PYTHON_PACKAGE_SECTION python)
set(CPACK_DEBIAN_PYTHON_PACKAGE_ARCHITECTURE all)
set(CPACK_DEBIAN_PYTHON_PACKAGE_DEPENDS "python3 (>= 3.11), python3-grpcio (>= 1.51), python3-protobuf (>= 3.21), python3-numpy (>= 1:1.21)")
set(CPACK_DEBIAN_PYTHON_PACKAGE_SUGGESTS "gobo, python3-xxhash, python3-openimageio, python3-matplotlib")
set(CPACK_DEBIAN_PYTHON_PACKAGE_CONTROL_EXTRA ${CMAKE_SOURCE_DIR}/deploy/debian/python/postinst ${CMAKE_SOURCE_DIR}/deploy/debian/python/prerm)
set(CPACK_COMPONENT_PYTHON_DESCRIPTION "client of the Gobo rendering server for Python
Renders, relights, submits jobs and reads pictures as numpy arrays, blocking or
with asyncio.")

set(CPACK_DEBIAN_DEV_PACKAGE_NAME gobo-dev)
set(CPACK_DEBIAN_DEV_PACKAGE_SECTION libdevel)
# Those of find_package(gobo) (cmake/gobo-config.cmake); gobo of the same build has the modules that read picture formats and OpenColorIO configs.
set(CPACK_DEBIAN_DEV_PACKAGE_DEPENDS "gobo (= ${PROJECT_VERSION}-1), libtbb-dev, libembree-dev, libopenexr-dev, libpng-dev, libjpeg62-turbo-dev | libjpeg-dev, \
libmeshoptimizer-dev, libprotobuf-dev, protobuf-compiler, libvulkan-dev, libsqlite3-dev, libdraco-dev, libegl-dev, libmuparser-dev, pkg-config")
set(CPACK_COMPONENT_DEV_DESCRIPTION "the Gobo renderer as a library
Headers, static libraries and the CMake package (find_package(gobo),
gobo::renderer) with which a program renders and relights in its own process.")
include(CPack)
