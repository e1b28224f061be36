#include "flow_session.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  elliptude::fuzz::flow_session<elliptude::fuzz::BodyWorld>({data, size});
  return 0;
}
