#pragma once
#include <string>
#include <string_view>

// The operator page's files, as they are packed into the program. Reentrant.
namespace overfly::page {

struct Asset {
  std::string path;  // "/index.html"
  std::string_view media_type;
  std::string_view gzipped;
  std::string etag;  // strong, quoted, of the content
};

// nullptr: no such file.
[[nodiscard]] const Asset* find(std::string_view path);
[[nodiscard]] std::string unpacked(const Asset& asset);

}  // namespace overfly::page
