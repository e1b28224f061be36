# cmake -DNM=<nm> -P check_symbols.cmake -- <object>...
# Fails if an object refers to a symbol by which memory is allocated or freed, an exception thrown, or a lock taken, or to a function
# of the mathematical library.
set(forbidden
    "(malloc|calloc|realloc|free|aligned_alloc|posix_memalign|memalign)" # the C heap
    "_Zn[wa].*" # operator new, new[]
    "_Zd[la].*" # operator delete, delete[]
    "__cxa_(throw|rethrow|allocate_exception)"
    "_ZSt[0-9]+__throw_.*" # how the standard library throws
    "__cxa_guard_acquire" # the lock of a function's static variable
    "pthread_mutex_lock"
    "(a?(sin|cos|tan)h?|atan2|sincos|exp|exp2|expm1|log|log2|log10|log1p|pow|sqrt|cbrt|hypot|fma|fmod|remainder|ceil|floor|round|trunc|rint|nearbyint|lround|lrint|ldexp|frexp|scalbn?|logb|ilogb|modf)[fl]?")
list(JOIN forbidden "|" forbidden)

set(objects "")
set(after_dashes FALSE)
foreach(i RANGE ${CMAKE_ARGC})
  if(after_dashes AND DEFINED CMAKE_ARGV${i})
    list(APPEND objects "${CMAKE_ARGV${i}}")
  elseif("${CMAKE_ARGV${i}}" STREQUAL "--")
    set(after_dashes TRUE)
  endif()
endforeach()
if(NOT objects)
  message(FATAL_ERROR "no object given")
endif()

set(found "")
foreach(object IN LISTS objects)
  execute_process(COMMAND "${NM}" -u -j "${object}" OUTPUT_VARIABLE symbols COMMAND_ERROR_IS_FATAL ANY)
  string(REGEX REPLACE "[ \n]+" ";" symbols "${symbols}")
  foreach(symbol IN LISTS symbols)
    if(symbol MATCHES "^(${forbidden})$")
      string(APPEND found "\n${object} refers to ${symbol}")
    endif()
  endforeach()
endforeach()
if(found)
  message(FATAL_ERROR "${found}")
endif()
message(STATUS "no forbidden symbol in ${objects}")
