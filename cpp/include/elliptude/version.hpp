// SPDX-License-Identifier: MIT
// The one home of the version number: CMakeLists.txt and pyproject.toml read it from here.
#pragma once

#define ELLIPTUDE_VERSION_MAJOR 0
#define ELLIPTUDE_VERSION_MINOR 1
#define ELLIPTUDE_VERSION_PATCH 0

// Two steps, so that the numbers are expanded before they become text.
#define ELLIPTUDE_DETAIL_TEXT(x) #x
#define ELLIPTUDE_DETAIL_DOTTED(major, minor, patch) \
  ELLIPTUDE_DETAIL_TEXT(major) "." ELLIPTUDE_DETAIL_TEXT(minor) "." ELLIPTUDE_DETAIL_TEXT(patch)

namespace elliptude {

inline constexpr int version_major = ELLIPTUDE_VERSION_MAJOR;
inline constexpr int version_minor = ELLIPTUDE_VERSION_MINOR;
inline constexpr int version_patch = ELLIPTUDE_VERSION_PATCH;

/// The version as text, "major.minor.patch".
inline constexpr const char version_string[] =
    ELLIPTUDE_DETAIL_DOTTED(ELLIPTUDE_VERSION_MAJOR, ELLIPTUDE_VERSION_MINOR, ELLIPTUDE_VERSION_PATCH);

}  // namespace elliptude

#undef ELLIPTUDE_DETAIL_DOTTED
#undef ELLIPTUDE_DETAIL_TEXT
