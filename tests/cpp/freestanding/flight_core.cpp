// Includes the whole core and instantiates it, to be compiled with -fno-exceptions -fno-rtti.
#if __has_include("elliptude/elliptude.hpp")
#include "elliptude/elliptude.hpp"
#endif
#include "elliptude/version.hpp"

const char* flight_core_version() { return elliptude::version_string; }
