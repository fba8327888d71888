#include <fmt/format.h>

#include <charconv>

#include "tiling/store/map_store.h"

namespace overfly::tiling {

std::string ChangeCursor::text() const {
  return fmt::format("{}.{}.{}.{}{}", since, until, zoom, revision, done ? ".end" : "");
}

Result<ChangeCursor> ChangeCursor::parse(const std::string& text) {
  const auto refuse = [&] {
    return fail(
        ErrorCode::BadInput,
        fmt::format("\"{}\" is no place in a list of changes; begin with since=0", text.substr(0, 80)));
  };
  std::uint64_t parts[4] = {};
  int count = 0;
  const char* at = text.data();
  const char* const end = at + text.size();
  ChangeCursor cursor;
  while (count < 4) {
    const auto [next, problem] = std::from_chars(at, end, parts[count]);
    if (problem != std::errc{}) return refuse();
    ++count;
    at = next;
    if (at == end) break;
    if (*at != '.' || ++at == end) return refuse();
    if (count == 4 && std::string_view(at, static_cast<std::size_t>(end - at)) == "end") {
      cursor.done = true;
      at = end;
    }
  }
  // Revisions are SQLite integers: 63 bits.
  constexpr std::uint64_t kMost = INT64_MAX;
  if (at != end || (count != 1 && count != 4) || parts[0] > kMost || parts[1] > kMost || parts[2] > 63 ||
      parts[3] > kMost)
    return refuse();
  cursor.since = parts[0];
  cursor.until = parts[1];
  cursor.zoom = static_cast<int>(parts[2]);
  cursor.revision = parts[3];
  return cursor;
}

}  // namespace overfly::tiling
