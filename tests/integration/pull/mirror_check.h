#pragma once
#include <gtest/gtest.h>

#include "tiling/store/map_store.h"

namespace overfly::test {

struct MapSize {
  std::size_t layers = 0;
  std::uint64_t bytes = 0, largest = 0;
};

// All that is to be mirrored of a map.
inline std::vector<tiling::Change> contents(const tiling::MapReader& reader) {
  std::vector<tiling::Change> out;
  auto cursor = tiling::ChangeCursor::after(0);
  while (!cursor.done) {
    const auto page = reader.changes(cursor, {.box = {}, .layers = tiling::kLinkLayers}, 1000);
    if (!page) throw std::runtime_error(page.error().message);
    out.insert(out.end(), page->changes.begin(), page->changes.end());
    cursor = page->next;
  }
  std::erase_if(out, [](const tiling::Change& change) { return change.erased; });
  return out;
}

inline MapSize sizeOf(const tiling::MapReader& reader) {
  MapSize out;
  for (const auto& change : contents(reader)) {
    ++out.layers;
    out.bytes += change.bytes;
    out.largest = std::max<std::uint64_t>(out.largest, change.bytes);
  }
  return out;
}

// Every layer of every tile, byte for byte, and nothing else.
inline void expectSame(const std::filesystem::path& drone, const std::filesystem::path& mirror) {
  const auto a = tiling::MapReader::open(drone), b = tiling::MapReader::open(mirror);
  ASSERT_TRUE(a) << a.error().message;
  ASSERT_TRUE(b) << b.error().message;
  EXPECT_TRUE(b->verify()->empty());
  const auto there = contents(*a);
  EXPECT_EQ(contents(*b).size(), there.size());
  for (const auto& one : there) {
    const auto from = a->read(one.key, one.layer), to = b->read(one.key, one.layer);
    ASSERT_TRUE(from && to) << one.key.zoom << "/" << one.key.x << "/" << one.key.y;
    EXPECT_EQ(from->encoded.codec, to->encoded.codec);
    EXPECT_EQ(from->encoded.bytes, to->encoded.bytes);
    EXPECT_EQ(from->encoded.statistics, to->encoded.statistics);
  }
}

}  // namespace overfly::test
