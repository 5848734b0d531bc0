# find_package(thetabus) after an installation as in clients/c/README.md; targets thetabus::thetabus (shared) and thetabus::static.
get_filename_component(_thetabus_prefix "${CMAKE_CURRENT_LIST_DIR}/../../.." ABSOLUTE)
if(NOT TARGET thetabus::thetabus)
  add_library(thetabus::thetabus SHARED IMPORTED)
  set_target_properties(thetabus::thetabus PROPERTIES
    IMPORTED_LOCATION "${_thetabus_prefix}/lib/libthetabus_c.so"
    IMPORTED_NO_SONAME TRUE
    INTERFACE_INCLUDE_DIRECTORIES "${_thetabus_prefix}/include")
  add_library(thetabus::static STATIC IMPORTED)
  set_target_properties(thetabus::static PROPERTIES
    IMPORTED_LOCATION "${_thetabus_prefix}/lib/libthetabus_c.a"
    INTERFACE_INCLUDE_DIRECTORIES "${_thetabus_prefix}/include"
    INTERFACE_LINK_LIBRARIES "pthread;dl;m;rt;gcc_s")
endif()
unset(_thetabus_prefix)
