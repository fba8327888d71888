#pragma once
#include <sys/wait.h>

#include <array>
#include <cstdio>
#include <string>

namespace overfly::test {

struct Outcome {
  int status = -1;  // of the command; -1: it did not end by itself
  std::string output;
};

// A command line of the shell, and what it wrote to its standard output and error.
inline Outcome shell(const std::string& command) {
  Outcome out;
  FILE* pipe = popen(("( " + command + " ) 2>&1").c_str(), "r");
  if (pipe == nullptr) return out;
  std::array<char, 4096> block{};
  while (const std::size_t bytes = std::fread(block.data(), 1, block.size(), pipe))
    out.output.append(block.data(), bytes);
  const int status = pclose(pipe);
  if (WIFEXITED(status)) out.status = WEXITSTATUS(status);
  return out;
}

}  // namespace overfly::test
