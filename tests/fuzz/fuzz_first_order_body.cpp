#include "first_order_session.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  elliptude::fuzz::first_order_session<elliptude::fuzz::BodyWorld>({data, size});
  return 0;
}
