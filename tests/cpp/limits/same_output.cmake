# cmake -P same_output.cmake -- <program> <program>
# Fails unless both succeed and print the same.
math(EXPR last "${CMAKE_ARGC} - 1")
math(EXPR first "${CMAKE_ARGC} - 2")
execute_process(COMMAND "${CMAKE_ARGV${first}}" OUTPUT_VARIABLE one COMMAND_ERROR_IS_FATAL ANY)
execute_process(COMMAND "${CMAKE_ARGV${last}}" OUTPUT_VARIABLE other COMMAND_ERROR_IS_FATAL ANY)
if(one STREQUAL "" OR NOT one STREQUAL other)
  message(FATAL_ERROR "the programs print different numbers, or nothing")
endif()
