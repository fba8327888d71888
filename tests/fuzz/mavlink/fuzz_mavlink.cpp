#include <cstdint>
#include <cstdlib>
#include <vector>

#include "capture/pose/mavlink/parser.h"

// Any bytes as a link, in pieces: the same packets come out as in one piece, and a whole packet behind them
// too.
//   build/fuzz/tests/fuzz/mavlink/fuzz_mavlink -max_total_time=60 tests/fuzz/mavlink/corpus
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace overfly::mavlink;
  std::vector<std::uint8_t> stream(data, data + size);
  const auto last = encode(Timesync{1, 2, 3, 4}, {9, 9}, 0);
  stream.insert(stream.end(), last.begin(), last.end());
  stream.insert(stream.end(), kMaxPacket, 0);  // lets a false beginning run out
  Parser whole, pieces;
  int count = 0, count_in_pieces = 0;
  whole.feed(stream, [&](const Packet&, std::span<const std::uint8_t> raw) {
    if (raw.size() > kMaxPacket) std::abort();
    ++count;
  });
  const std::size_t piece = size == 0 ? 1 : 1 + data[0] % 32;
  for (std::size_t at = 0; at < stream.size(); at += piece) {
    pieces.feed(std::span(stream).subspan(at, std::min(piece, stream.size() - at)),
                [&](const Packet&, std::span<const std::uint8_t>) { ++count_in_pieces; });
  }
  if (count < 1 || count != count_in_pieces) std::abort();
  return 0;
}
