// The main function of every test program: it runs the test cases of the file that the program is named after, as its object may
// hold those of others.
#define DOCTEST_CONFIG_IMPLEMENT
#include <doctest/doctest.h>

#include <filesystem>
#include <string>

int main(int argc, char** argv) {
  doctest::Context context;
  const std::string name = std::filesystem::path(argv[0]).stem().string();
  context.addFilter("source-file", ("*" + name + ".cpp").c_str());
  context.applyCommandLine(argc, argv);
  return context.run();
}
