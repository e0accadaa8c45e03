# Run by CPack between installing into the packages' folders and packing them (cmake/package.cmake): what the packages have beside installed files, at places that
# `cmake --install` must not write to, and texts as Debian keeps them.
cmake_policy(VERSION 3.25)
set(packages ${CPACK_TEMPORARY_DIRECTORY})
foreach(component IN LISTS CPACK_COMPONENTS_ALL)
  string(TOUPPER ${component} name)
  file(COPY ${CPACK_GOBO_DEBIAN}/copyright DESTINATION ${packages}/${component}/usr/share/doc/${CPACK_DEBIAN_${name}_PACKAGE_NAME})
endforeach()
if(gobo IN_LIST CPACK_COMPONENTS_ALL)
  file(COPY ${CPACK_GOBO_DEBIAN}/gobod.toml DESTINATION ${packages}/gobo/etc/gobo)
  file(REMOVE ${packages}/gobo/usr/share/doc/gobo/LICENSE)   # the copyright file says where it is
  file(GLOB pages ${packages}/gobo/usr/share/man/man*/*.[1-9])
  foreach(page IN LISTS pages)
    execute_process(COMMAND gzip -9n ${page} COMMAND_ERROR_IS_FATAL ANY)
  endforeach()
  # Packages of what is linked, with the versions whose symbols are used. CPACK_DEBIAN_PACKAGE_SHLIBDEPS would look at each of some hundred texts with two programs.
  file(MAKE_DIRECTORY ${packages}/debian)
  file(WRITE ${packages}/debian/control "")
  execute_process(COMMAND dpkg-shlibdeps -O ${packages}/gobo/usr/bin/gobod ${packages}/gobo/usr/bin/gobo ${packages}/gobo/usr/bin/gobo-ingest
    ${packages}/gobo/usr/lib/gobo/libgobo_image_codec.so ${packages}/gobo/usr/lib/gobo/libgobo_color.so WORKING_DIRECTORY ${packages} OUTPUT_VARIABLE linked ERROR_VARIABLE said RESULT_VARIABLE failed)
  file(REMOVE_RECURSE ${packages}/debian)
  if(failed OR NOT linked MATCHES "shlibs:Depends=([^\n]+)")
    message(FATAL_ERROR "dpkg-shlibdeps: ${said}")
  endif()
  set(CPACK_DEBIAN_GOBO_PACKAGE_DEPENDS "${CMAKE_MATCH_1}, ${CPACK_DEBIAN_GOBO_PACKAGE_DEPENDS}")
endif()
