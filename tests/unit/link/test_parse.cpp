#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include "daemon/link/bundle.h"
#include "daemon/link/detail/parse.h"

namespace overfly::link {
namespace {

TEST(TilePathTest, ReadsWholePathsAndRefusesTheRest) {
  const auto path = parseTilePath("/tiles/color/17/68000/44000.webp");
  ASSERT_TRUE(path);
  EXPECT_EQ(path->layer, "color");
  EXPECT_EQ(path->zoom, 17);
  EXPECT_EQ(path->x, 68000);
  EXPECT_EQ(path->y, 44000);
  EXPECT_EQ(path->extension, "webp");
  for (const auto* bad :
       {"/tiles/color/1/2/0.png", "/tiles/color/1/0/2.png", "/tiles/color/31/0/0.png",
        "/tiles/color/-1/0/0.png", "/tiles/color/1/0/0", "/tiles/color/1/0/0.", "/tiles//1/0/0.png",
        "/tiles/color/1/ 0/0.png", "/tiles/color/1/0x1/0.png", "/tiles/color/99999999999999999999/0/0.png",
        "/tiles/color/1/0/0.png/../..", "", "/", "/tiles/"})
    EXPECT_FALSE(parseTilePath(bad)) << bad;
}

TEST(BoxTest, AntimeridianIsAllowedAndNonsenseIsNot) {
  const auto box = parseBox("179.5,-17,-179.5,-16");
  ASSERT_TRUE(box);
  EXPECT_GT(box->west, box->east);
  for (const auto* bad :
       {"", "1,2,3", "1,2,3,4,5", "1,2,3,nan", "1,9,3,4", "1,2,3,91", "1,2,3,inf", "a,b,c,d", "1,2,,4"})
    EXPECT_FALSE(parseBox(bad)) << bad;
}

TEST(EtagTest, ListsWeakTagsAndStars) {
  EXPECT_TRUE(etagListed("\"a\"", "\"a\""));
  EXPECT_TRUE(etagListed("\"b\" , W/\"a\"", "\"a\""));
  EXPECT_TRUE(etagListed("*", "\"a\""));
  EXPECT_FALSE(etagListed("", "\"a\""));
  EXPECT_FALSE(etagListed("a", "\"a\""));
  EXPECT_FALSE(etagListed("\"ab\"", "\"a\""));
}

TEST(TokenTest, PathsSplitAndSecretsCompare) {
  const auto split = splitTokenPath("/t/abc/tiles/x");
  ASSERT_TRUE(split);
  EXPECT_EQ(split->token, "abc");
  EXPECT_EQ(split->rest, "/tiles/x");
  EXPECT_EQ(splitTokenPath("/t/abc")->rest, "/");
  EXPECT_FALSE(splitTokenPath("/t//tiles"));
  EXPECT_FALSE(splitTokenPath("/tiles"));
  EXPECT_TRUE(equalSecrets("abc", "abc"));
  EXPECT_FALSE(equalSecrets("abcabc", "abc"));
  EXPECT_FALSE(equalSecrets("", "abc"));
  EXPECT_FALSE(equalSecrets("", ""));
  EXPECT_EQ(cookie("a=1; overfly_token=xyz; b=2", "overfly_token"), "xyz");
  EXPECT_EQ(cookie("not_overfly_token=xyz", "overfly_token"), "");
}

RC_GTEST_PROP(WantedProperty, TextSurvivesTheRoundTrip, ()) {
  WantedTile wanted;
  wanted.layer = *rc::gen::element(tiling::Layer::Color, tiling::Layer::Elevation, tiling::Layer::Quality);
  wanted.key = {*rc::gen::inRange(0, 30), *rc::gen::inRange<std::int64_t>(-1000000, 1000000),
                *rc::gen::inRange<std::int64_t>(0, 1000000)};
  wanted.bytes = *rc::gen::inRange<std::uint64_t>(0, 100000);
  wanted.revision = wanted.bytes == 0 ? 0 : *rc::gen::inRange<std::uint64_t>(1, 100000);
  const auto parsed = parseWanted(text(wanted) + ";" + text(wanted));
  RC_ASSERT(parsed.has_value());
  RC_ASSERT(parsed->size() == 2u);
  RC_ASSERT(parsed->at(1).key == wanted.key);
  RC_ASSERT(parsed->at(1).layer == wanted.layer);
  RC_ASSERT(parsed->at(1).bytes == wanted.bytes);
  RC_ASSERT(parsed->at(1).revision == wanted.revision);
}

RC_GTEST_PROP(RecordProperty, ADamagedByteIsNoticed, ()) {
  TileRecord record;
  record.key = {17, *rc::gen::inRange<std::int64_t>(-5, 100000), 44};
  record.revision = 12;
  record.gsd_m = 0.05F;
  tiling::StoredLayer layer;
  layer.encoded.layer = tiling::Layer::Elevation;
  layer.encoded.codec = tiling::Codec::Heights;
  layer.encoded.bytes = *rc::gen::container<std::vector<std::uint8_t>>(rc::gen::arbitrary<std::uint8_t>());
  layer.encoded.statistics = {1.0F, 2.0F, 77};
  layer.revision = 11;
  record.layers = {layer};
  auto bytes = encodeRecord(record);
  const auto decoded = decodeRecord(bytes);
  RC_ASSERT(decoded.has_value());
  RC_ASSERT(decoded->key == record.key);
  RC_ASSERT(decoded->layers.at(0).encoded.bytes == layer.encoded.bytes);
  RC_ASSERT(decoded->layers.at(0).encoded.statistics == layer.encoded.statistics);
  RC_ASSERT(!decodeRecord(std::string_view(bytes).substr(0, bytes.size() - 1)).has_value());
  const auto at = *rc::gen::inRange<std::size_t>(0, bytes.size());
  bytes[at] = static_cast<char>(bytes[at] ^ (1 << *rc::gen::inRange(0, 8)));
  RC_ASSERT(!decodeRecord(bytes).has_value());
}

}  // namespace
}  // namespace overfly::link
