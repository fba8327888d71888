#include <gtest/gtest.h>

#include <random>

#include "daemon/pull/event_parser.h"
#include "daemon/pull/record_stream.h"

namespace overfly::pull {
namespace {

link::TileRecord record(int x, std::size_t bytes, std::uint64_t revision) {
  link::TileRecord out;
  out.key = {18, x, 7};
  out.revision = revision;
  tiling::StoredLayer layer;
  layer.encoded.layer = tiling::Layer::Color;
  layer.encoded.codec = tiling::Codec::Jpeg;
  layer.revision = revision;
  for (std::size_t i = 0; i < bytes; ++i)
    layer.encoded.bytes.push_back(static_cast<std::uint8_t>(i * 31 + revision));
  out.layers.push_back(layer);
  return out;
}

// Whatever the answer is cut into and wherever it breaks off, asking again from there brings every record
// once.
TEST(RecordStream, GoesOnAtAnyByte) {
  std::vector<std::string> whole;
  for (int i = 0; i < 4; ++i)
    whole.push_back(encodeRecord(record(i, 100 + 70 * static_cast<std::size_t>(i), 5)));
  const std::string all = whole[0] + whole[1] + whole[2] + whole[3];
  std::mt19937 random(3);
  for (std::size_t cut = 1; cut < all.size(); cut += 7) {
    std::size_t came = 0;
    RecordStream first;
    for (std::size_t at = 0; at < cut;) {
      const auto part = std::min<std::size_t>(1 + random() % 90, cut - at);
      const auto records = first.feed(std::string_view(all).substr(at, part));
      ASSERT_TRUE(records);
      came += records->size();
      at += part;
    }
    std::deque<Begun> begun;
    for (auto& part : first.parts()) begun.push_back(std::move(part));
    ASSERT_LE(begun.size(), 1u);
    std::string rest;
    const auto have = begun.empty() ? 0 : begun[0].bytes.size();
    for (std::size_t i = came; i < 4; ++i) rest += i == came ? whole[i].substr(have) : whole[i];
    RecordStream second(std::move(begun));
    const auto records = second.feed(rest);
    ASSERT_TRUE(records) << "cut at " << cut;
    EXPECT_EQ(came + records->size(), 4u) << "cut at " << cut;
    EXPECT_EQ(second.resumed(), have);
    EXPECT_TRUE(second.parts().empty());
  }
}

TEST(RecordStream, ABegunTileThatChangedComesWhole) {
  const auto old = encodeRecord(record(0, 500, 5)), fresh = encodeRecord(record(0, 300, 6));
  RecordStream stream({Begun{{{18, 0, 7}, tiling::Layer::Color}, 5, old.substr(0, 200)}});
  const auto records = stream.feed(fresh);
  ASSERT_TRUE(records);
  ASSERT_EQ(records->size(), 1u);
  EXPECT_EQ(records->front().revision, 6u);
  EXPECT_EQ(stream.resumed(), 0u);
}

TEST(RecordStream, SeveralBegunTilesGoOnInOneAnswer) {
  const auto a = encodeRecord(record(0, 500, 5)), b = encodeRecord(record(1, 400, 5)),
             c = encodeRecord(record(2, 90, 5));
  std::deque<Begun> begun{{{{18, 0, 7}, tiling::Layer::Color}, 5, a.substr(0, 200)},
                          {{{18, 2, 7}, tiling::Layer::Color}, 5, c.substr(0, 100)}};
  RecordStream stream(std::move(begun));
  const auto records = stream.feed(a.substr(200) + b + c.substr(100));
  ASSERT_TRUE(records);
  EXPECT_EQ(records->size(), 3u);
  EXPECT_EQ(stream.resumed(), 300u);
}

TEST(RecordStream, DamageIsNotTakenForATile) {
  auto bytes = encodeRecord(record(0, 500, 5));
  bytes[300] = static_cast<char>(bytes[300] ^ 1);
  RecordStream stream;
  EXPECT_FALSE(stream.feed(bytes));
  EXPECT_FALSE(RecordStream().feed("<html>no bundle</html>"));
}

TEST(EventParser, EventsComeWholeInWhateverPortions) {
  const std::string text =
      "event: hello\ndata: {}\n\n:\n\nid: 7/abc\r\nevent: change\r\ndata: [1,\ndata: 2]\r\n\r\n";
  for (std::size_t portion = 1; portion < text.size(); ++portion) {
    std::vector<std::string> got;
    EventParser parser([&](const std::string& event, const std::string& id, const std::string& data) {
      got.push_back(event + "|" + id + "|" + data);
    });
    for (std::size_t at = 0; at < text.size(); at += portion)
      parser.feed(std::string_view(text).substr(at, portion));
    ASSERT_EQ(got, (std::vector<std::string>{"hello||{}", "change|7/abc|[1,\n2]"})) << portion;
  }
}

}  // namespace
}  // namespace overfly::pull
