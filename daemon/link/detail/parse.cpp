#include "daemon/link/detail/parse.h"

#include <charconv>
#include <cmath>

namespace overfly::link {
namespace {

// Cuts off and returns what stands before `separator`, or everything.
std::string_view cut(std::string_view& rest, char separator) {
  const auto at = rest.find(separator);
  const auto head = rest.substr(0, at);
  rest = at == std::string_view::npos ? std::string_view() : rest.substr(at + 1);
  return head;
}

std::optional<TokenPath> splitPrefix(std::string_view path, std::string_view prefix) {
  if (!path.starts_with(prefix)) return std::nullopt;
  path.remove_prefix(prefix.size());
  const auto slash = path.find('/');
  const auto token = path.substr(0, slash);
  if (token.empty()) return std::nullopt;
  return TokenPath{token, slash == std::string_view::npos ? std::string_view("/") : path.substr(slash)};
}

std::optional<std::int64_t> parseIndex(std::string_view text) {
  std::int64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return value;
}

}  // namespace

std::optional<double> parseNumber(std::string_view text) {
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || !std::isfinite(value)) return std::nullopt;
  return value;
}

std::optional<std::uint64_t> parseCount(std::string_view text) {
  std::uint64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return value;
}

std::optional<TilePath> parseTilePath(std::string_view path) {
  constexpr std::string_view kPrefix = "/tiles/";
  if (!path.starts_with(kPrefix)) return std::nullopt;
  path.remove_prefix(kPrefix.size());
  TilePath out;
  out.layer = cut(path, '/');
  const auto zoom = parseCount(cut(path, '/'));
  const auto x = parseCount(cut(path, '/'));
  const auto y = parseCount(cut(path, '.'));
  if (!zoom || !x || !y || *zoom > 30 || out.layer.empty() || path.empty() || path.size() > 8)
    return std::nullopt;
  const std::uint64_t side = std::uint64_t{1} << *zoom;
  if (*x >= side || *y >= side) return std::nullopt;
  out.zoom = static_cast<int>(*zoom);
  out.x = static_cast<std::int64_t>(*x);
  out.y = static_cast<std::int64_t>(*y);
  out.extension = path;
  return out;
}

std::optional<DegreeBox> parseBox(std::string_view text) {
  std::array<double, 4> values{};
  for (auto& value : values) {
    const auto number = parseNumber(cut(text, ','));
    if (!number) return std::nullopt;
    value = *number;
  }
  const DegreeBox box{values[0], values[1], values[2], values[3]};
  const bool longitudes = std::abs(box.west) <= 360 && std::abs(box.east) <= 360;
  if (!text.empty() || !longitudes || box.south < -90 || box.north > 90 || box.south > box.north)
    return std::nullopt;
  return box;
}

std::optional<tiling::LayerSet> parseLayers(std::string_view text) {
  tiling::LayerSet out = 0;
  while (!text.empty()) {
    const auto layer = tiling::layerNamed(cut(text, ','));
    if (!layer) return std::nullopt;
    out |= tiling::only(*layer);
  }
  if (out == 0) return std::nullopt;
  return out;
}

bool etagListed(std::string_view if_none_match, std::string_view etag) {
  while (!if_none_match.empty()) {
    auto item = cut(if_none_match, ',');
    while (!item.empty() && (item.front() == ' ' || item.front() == '\t')) item.remove_prefix(1);
    while (!item.empty() && (item.back() == ' ' || item.back() == '\t')) item.remove_suffix(1);
    if (item == "*") return true;
    if (item.starts_with("W/")) item.remove_prefix(2);
    if (item == etag) return true;
  }
  return false;
}

std::optional<TokenPath> splitTokenPath(std::string_view path) { return splitPrefix(path, "/t/"); }
std::optional<TokenPath> splitMissionPath(std::string_view path) { return splitPrefix(path, "/m/"); }

std::string_view cookie(std::string_view header, std::string_view name) {
  while (!header.empty()) {
    auto item = cut(header, ';');
    while (!item.empty() && item.front() == ' ') item.remove_prefix(1);
    const auto key = cut(item, '=');
    if (key == name) return item;
  }
  return {};
}

namespace {

// "+BYTES@REVISION" or nothing.
bool parseHave(std::string_view have, std::uint64_t& bytes, std::uint64_t& revision) {
  if (have.empty()) return true;
  const auto b = parseCount(cut(have, '@'));
  const auto r = parseCount(have);
  if (!b || !r) return false;
  bytes = *b;
  revision = *r;
  return true;
}

}  // namespace

std::optional<BundlePlace> parseBundlePlace(const std::string& text) {
  std::string_view rest(text);
  const auto head = cut(rest, '+');
  auto cursor = tiling::ChangeCursor::parse(std::string(head));
  BundlePlace out;
  if (!cursor || !parseHave(rest, out.bytes, out.revision)) return std::nullopt;
  out.cursor = *cursor;
  return out;
}

std::string text(const BundlePlace& place) {
  auto out = place.cursor.text();
  if (place.bytes > 0) out += "+" + std::to_string(place.bytes) + "@" + std::to_string(place.revision);
  return out;
}

std::optional<std::vector<WantedTile>> parseWanted(std::string_view text, std::size_t limit) {
  std::vector<WantedTile> out;
  while (!text.empty()) {
    auto item = cut(text, ';');
    if (out.size() == limit) return std::nullopt;
    auto name = cut(item, '+');
    WantedTile wanted;
    const auto layer = tiling::layerNamed(cut(name, '/'));
    const auto zoom = parseIndex(cut(name, '/'));
    const auto x = parseIndex(cut(name, '/'));
    const auto y = parseIndex(name);
    if (!layer || !zoom || !x || !y || *zoom < 0 || *zoom > 40 ||
        !parseHave(item, wanted.bytes, wanted.revision))
      return std::nullopt;
    wanted.layer = *layer;
    wanted.key = {static_cast<int>(*zoom), *x, *y};
    out.push_back(wanted);
  }
  return out;
}

bool equalSecrets(std::string_view presented, std::string_view expected) {
  if (expected.empty()) return false;
  unsigned difference = presented.size() == expected.size() ? 0u : 1u;
  for (std::size_t i = 0; i < presented.size(); ++i) {
    const auto a = static_cast<unsigned char>(presented[i]);
    const auto b = static_cast<unsigned char>(expected[i % expected.size()]);
    difference |= static_cast<unsigned>(a ^ b);
  }
  return difference == 0;
}

}  // namespace overfly::link
