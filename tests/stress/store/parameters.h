#pragma once
#include <unistd.h>

#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <string>

namespace overfly::tiling {

// A count that the environment may raise for the long version of a test.
inline std::uint64_t parameter(const char* name, std::uint64_t otherwise) {
  const char* text = std::getenv(name);
  return text != nullptr ? std::stoull(text) : otherwise;
}

inline std::filesystem::path stressFolder(const std::string& name) {
  const std::filesystem::path memory = "/dev/shm";
  const auto base = access(memory.c_str(), W_OK) == 0 ? memory : std::filesystem::temp_directory_path();
  const auto folder = base / ("overfly-stress-" + name + "." + std::to_string(getpid()));
  std::filesystem::remove_all(folder);
  std::filesystem::create_directories(folder);
  return folder;
}

}  // namespace overfly::tiling
