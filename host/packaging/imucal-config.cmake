# find_package(imucal): the target imucal::imucal is the C core.
get_filename_component(_imucal_prefix "${CMAKE_CURRENT_LIST_DIR}/../../.." ABSOLUTE)
if(NOT TARGET imucal::imucal)
  add_library(imucal::imucal STATIC IMPORTED)
  set_target_properties(imucal::imucal PROPERTIES
    IMPORTED_LOCATION "${_imucal_prefix}/lib/libimucal.a"
    INTERFACE_INCLUDE_DIRECTORIES "${_imucal_prefix}/include/imucal"
    IMPORTED_LINK_INTERFACE_LANGUAGES C)
endif()
unset(_imucal_prefix)
