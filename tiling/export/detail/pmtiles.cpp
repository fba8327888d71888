// PMTiles version 3, https://github.com/protomaps/PMTiles/blob/main/spec/v3/spec.md. The file is laid out as
// header and root directory (within the first 16 kB, as the format asks), tile data, metadata, leaf
// directories: so tiles are written as they come.
#include <fmt/format.h>
#include <zlib.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>

#include "tiling/export/detail/source.h"

namespace overfly::tiling::detail {
namespace {

using Bytes = std::vector<std::uint8_t>;
constexpr std::size_t kHeaderBytes = 127;
constexpr std::size_t kDataAt = 16384;

struct Entry {
  std::uint64_t id = 0, offset = 0;
  std::uint32_t length = 0;
  std::uint32_t run = 1;  // 0: points to a leaf directory
};

void putVarint(Bytes& to, std::uint64_t value) {
  for (; value >= 0x80; value >>= 7) to.push_back(static_cast<std::uint8_t>(value | 0x80));
  to.push_back(static_cast<std::uint8_t>(value));
}

Bytes gzipped(const Bytes& plain) {
  z_stream stream{};
  deflateInit2(&stream, 9, Z_DEFLATED, MAX_WBITS + 16, 8, Z_DEFAULT_STRATEGY);
  Bytes packed(deflateBound(&stream, static_cast<uLong>(plain.size())) + 32);
  stream.next_in = const_cast<Bytef*>(plain.data());
  stream.avail_in = static_cast<uInt>(plain.size());
  stream.next_out = packed.data();
  stream.avail_out = static_cast<uInt>(packed.size());
  deflate(&stream, Z_FINISH);
  packed.resize(stream.total_out);
  deflateEnd(&stream);
  return packed;
}

Bytes directory(std::span<const Entry> entries) {
  Bytes plain;
  putVarint(plain, entries.size());
  std::uint64_t last = 0;
  for (const Entry& entry : entries) {
    putVarint(plain, entry.id - last);
    last = entry.id;
  }
  for (const Entry& entry : entries) putVarint(plain, entry.run);
  for (const Entry& entry : entries) putVarint(plain, entry.length);
  for (std::size_t i = 0; i < entries.size(); ++i) {
    const bool follows = i > 0 && entries[i].offset == entries[i - 1].offset + entries[i - 1].length;
    putVarint(plain, follows ? 0 : entries[i].offset + 1);
  }
  return gzipped(plain);
}

class PmTilesSink : public TileSink {
 public:
  explicit PmTilesSink(std::filesystem::path file) : path_(std::move(file)) {}

  Order order() const override { return Order::Hilbert; }

  Result<void> begin(const WebMetadata& metadata) override {
    metadata_ = metadata;
    file_.open(path_, std::ios::binary);
    const Bytes zeros(kDataAt);
    return put(zeros);
  }
  Result<void> add(const geo::TileKey& key, const Bytes& bytes) override {
    const std::uint64_t id =
        pmTileId(key.zoom, static_cast<std::uint64_t>(key.x), static_cast<std::uint64_t>(key.y));
    // A map wider than the world holds a place twice: the copies of one id are neighbours.
    if (!entries_.empty() && entries_.back().id == id) return {};
    entries_.push_back({id, data_bytes_, static_cast<std::uint32_t>(bytes.size()), 1});
    data_bytes_ += bytes.size();
    return put(bytes);
  }
  Result<void> finish() override {
    Bytes root = directory(entries_), leaves;
    for (std::size_t leaf_size = 4096; root.size() > kDataAt - kHeaderBytes; leaf_size *= 2) {
      leaves.clear();
      std::vector<Entry> pointers;
      for (std::size_t from = 0; from < entries_.size(); from += leaf_size) {
        const Bytes leaf =
            directory(std::span(entries_).subspan(from, std::min(leaf_size, entries_.size() - from)));
        pointers.push_back({entries_[from].id, leaves.size(), static_cast<std::uint32_t>(leaf.size()), 0});
        leaves.insert(leaves.end(), leaf.begin(), leaf.end());
      }
      root = directory(pointers);
    }
    nlohmann::json json = {{"name", metadata_.name},
                           {"type", "overlay"},
                           {"description", fmt::format("{} of map {}", metadata_.layer, metadata_.id)},
                           {"version", std::to_string(metadata_.revision)}};
    if (metadata_.layer == "elevation") {
      json["encoding"] = "terrarium";
      json["vertical_datum"] = metadata_.datum;
    }
    const std::string text = json.dump();
    const Bytes about = gzipped({text.begin(), text.end()});
    if (Result<void> done = put(about); !done) return done;
    if (Result<void> done = put(leaves); !done) return done;

    Bytes header(kHeaderBytes);
    std::memcpy(header.data(), "PMTiles\3", 8);
    const std::uint64_t numbers[] = {kHeaderBytes,
                                     root.size(),
                                     kDataAt + data_bytes_,
                                     about.size(),
                                     kDataAt + data_bytes_ + about.size(),
                                     leaves.size(),
                                     kDataAt,
                                     data_bytes_,
                                     entries_.size(),
                                     entries_.size(),
                                     entries_.size()};
    std::memcpy(header.data() + 8, numbers, sizeof numbers);
    constexpr std::uint8_t kClustered = 1, kGzip = 2, kPlain = 1;
    const std::uint8_t type = metadata_.format == WebFormat::Png    ? 2
                              : metadata_.format == WebFormat::Jpeg ? 3
                                                                    : 4;
    const std::uint8_t small[] = {kClustered,
                                  kGzip,
                                  kPlain,
                                  type,
                                  static_cast<std::uint8_t>(metadata_.min_zoom),
                                  static_cast<std::uint8_t>(metadata_.max_zoom)};
    std::memcpy(header.data() + 96, small, sizeof small);
    const auto e7 = [](double degrees) { return static_cast<std::int32_t>(std::lround(degrees * 1e7)); };
    const std::int32_t box[] = {e7(metadata_.west), e7(metadata_.south), e7(metadata_.east),
                                e7(metadata_.north)};
    std::memcpy(header.data() + 102, box, sizeof box);
    header[118] = static_cast<std::uint8_t>(metadata_.max_zoom);
    const std::int32_t centre[] = {e7((metadata_.west + metadata_.east) / 2),
                                   e7((metadata_.south + metadata_.north) / 2)};
    std::memcpy(header.data() + 119, centre, sizeof centre);
    file_.seekp(0);
    if (Result<void> done = put(header); !done) return done;
    if (Result<void> done = put(root); !done) return done;
    file_.close();
    if (!file_) return fail(ErrorCode::Io, fmt::format("{} cannot be written", path_.string()));
    return {};
  }

 private:
  Result<void> put(const Bytes& bytes) {
    file_.write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
    if (!file_) return fail(ErrorCode::Io, fmt::format("{} cannot be written", path_.string()));
    return {};
  }

  std::filesystem::path path_;
  std::ofstream file_;
  WebMetadata metadata_;
  std::vector<Entry> entries_;
  std::uint64_t data_bytes_ = 0;
};

}  // namespace

std::uint64_t pmTileId(int zoom, std::uint64_t x, std::uint64_t y) {
  std::uint64_t id = ((std::uint64_t{1} << (2 * zoom)) - 1) / 3;  // tiles of all coarser zooms
  for (std::uint64_t half = (std::uint64_t{1} << zoom) >> 1; half > 0; half >>= 1) {
    const std::uint64_t right = (x & half) != 0 ? 1 : 0, low = (y & half) != 0 ? 1 : 0;
    id += half * half * ((3 * right) ^ low);
    if (low == 0) {
      if (right == 1) {
        x = half - 1 - x;
        y = half - 1 - y;
      }
      std::swap(x, y);
    }
  }
  return id;
}

std::unique_ptr<TileSink> pmTilesSink(const std::filesystem::path& file) {
  return std::make_unique<PmTilesSink>(file);
}

}  // namespace overfly::tiling::detail
