#pragma once
#include <cstddef>

// The table that CMake writes; assets.h is the face.
namespace overfly::page {

struct PackedFile {
  const char* path;
  const char* media_type;
  const char* begin;
  const char* end;
};
extern const PackedFile kPacked[];
extern const std::size_t kPackedCount;

}  // namespace overfly::page
