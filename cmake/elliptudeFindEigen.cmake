# Finds Eigen, 3.4 or newer, Eigen 5 included, and defines Eigen3::Eigen. Used by the project itself and by its installed
# package. Result: elliptude_eigen_FOUND, else elliptude_eigen_NOT_FOUND_MESSAGE.
#
# No version is given to find_package(): Eigen's own version file takes a request for 3.4 to mean 3.x only.
#
# PATHS is searched last, so the system's Eigen comes first. It names the places where PyPI's cmeel-eigen lies: beside the
# Python packages in CMAKE_PREFIX_PATH (scikit-build-core puts the build environment there), and beside this file's own
# package when it is part of a Python wheel, <site-packages>/elliptude/share/cmake/elliptude.
set(elliptude_eigen_FOUND FALSE)

if(NOT TARGET Eigen3::Eigen)
  set(elliptude_cmeel_prefixes ${CMAKE_PREFIX_PATH} "${CMAKE_CURRENT_LIST_DIR}/../../../..")
  list(TRANSFORM elliptude_cmeel_prefixes APPEND "/cmeel.prefix")
  find_package(Eigen3 CONFIG QUIET PATHS ${elliptude_cmeel_prefixes})
  unset(elliptude_cmeel_prefixes)
endif()

if(NOT TARGET Eigen3::Eigen)
  set(elliptude_eigen_NOT_FOUND_MESSAGE
      "elliptude needs Eigen 3.4 or newer: install libeigen3-dev (Debian) or cmeel-eigen (PyPI), or set Eigen3_DIR")
elseif(DEFINED Eigen3_VERSION AND Eigen3_VERSION VERSION_LESS 3.4)
  set(elliptude_eigen_NOT_FOUND_MESSAGE
      "elliptude needs Eigen 3.4 or newer, but ${Eigen3_DIR} is Eigen ${Eigen3_VERSION}")
else()
  set(elliptude_eigen_FOUND TRUE)
  message(STATUS "elliptude: Eigen ${Eigen3_VERSION} from ${Eigen3_DIR}")
endif()
