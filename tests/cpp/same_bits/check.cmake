# cmake "-DPROGRAM=<program, after what emulates its processor>" -DNAME=<name> -P check.cmake
# Fails unless the rows that the program prints have the hash that golden.txt has for that name.
execute_process(COMMAND ${PROGRAM} OUTPUT_VARIABLE printed COMMAND_ERROR_IS_FATAL ANY)
string(REGEX MATCHALL "row [^\n]*" rows "${printed}")
list(LENGTH rows count)
string(SHA256 hash "${rows}")
file(STRINGS "${CMAKE_CURRENT_LIST_DIR}/golden.txt" golden REGEX "^${NAME} ")
if(NOT golden STREQUAL "${NAME} ${count} ${hash}")
  message(FATAL_ERROR "the bits are others: '${NAME} ${count} ${hash}', and not '${golden}'")
endif()
