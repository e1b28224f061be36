#include "filter_session.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  elliptude::fuzz::FilterSession<elliptude::fuzz::BodyWorld>({data, size}).run();
  return 0;
}
