#include "daemon/page/assets.h"

#include <zlib.h>

#include <array>
#include <cstdint>
#include <cstdio>
#include <vector>

#include "daemon/page/packed.h"

namespace overfly::page {
namespace {

std::vector<Asset> load() {
  std::vector<Asset> out;
  for (std::size_t i = 0; i < kPackedCount; ++i) {
    const auto& file = kPacked[i];
    const std::string_view bytes(file.begin, static_cast<std::size_t>(file.end - file.begin));
    std::uint64_t hash = 0xcbf29ce484222325ull;  // FNV-1a
    for (const char c : bytes) hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001b3ull;
    std::array<char, 24> etag{};
    std::snprintf(etag.data(), etag.size(), "\"%016llx\"", static_cast<unsigned long long>(hash));
    out.push_back({file.path, file.media_type, bytes, etag.data()});
  }
  return out;
}

}  // namespace

const Asset* find(std::string_view path) {
  static const std::vector<Asset> assets = load();
  for (const auto& asset : assets)
    if (asset.path == path) return &asset;
  return nullptr;
}

std::string unpacked(const Asset& asset) {
  z_stream stream{};
  constexpr int kGzip = 16;
  if (inflateInit2(&stream, MAX_WBITS + kGzip) != Z_OK) return {};
  std::string out;
  std::array<char, 32768> block{};
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(asset.gzipped.data()));
  stream.avail_in = static_cast<uInt>(asset.gzipped.size());
  int status = Z_OK;
  while (status == Z_OK) {
    stream.next_out = reinterpret_cast<Bytef*>(block.data());
    stream.avail_out = static_cast<uInt>(block.size());
    status = inflate(&stream, Z_NO_FLUSH);
    out.append(block.data(), block.size() - stream.avail_out);
  }
  inflateEnd(&stream);
  return out;
}

}  // namespace overfly::page
