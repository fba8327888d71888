#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "config/error.h"
#include "daemon/link/bundle.h"
#include "tiling/store/map_store.h"

// Everything that reads a client's text. Pure functions over untrusted bytes: no allocation beyond the
// input's size, no exceptions; tests/fuzz/http feeds them.
namespace overfly::link {

// "/tiles/LAYER/Z/X/Y.EXT": 0 <= z <= 30, x and y within the zoom.
struct TilePath {
  std::string layer;
  int zoom = 0;
  std::int64_t x = 0, y = 0;
  std::string extension;
};
[[nodiscard]] std::optional<TilePath> parseTilePath(std::string_view path);

// Whole-string numbers: no spaces, no sign where unsigned, finite.
[[nodiscard]] std::optional<double> parseNumber(std::string_view text);
[[nodiscard]] std::optional<std::uint64_t> parseCount(std::string_view text);

// "west,south,east,north" in degrees; west > east crosses the antimeridian. Latitudes in [-90, 90].
struct DegreeBox {
  double west = 0, south = 0, east = 0, north = 0;
};
[[nodiscard]] std::optional<DegreeBox> parseBox(std::string_view text);

// "color,elevation" to a set; nullopt when a name is unknown or nothing is named.
[[nodiscard]] std::optional<tiling::LayerSet> parseLayers(std::string_view text);

// Does an If-None-Match header name this entity tag (strong, quoted) or "*"? Weak tags compare equal, as
// RFC 9110, 13.1.2 asks.
[[nodiscard]] bool etagListed(std::string_view if_none_match, std::string_view etag);

// "/t/TOKEN/rest" to TOKEN and "/rest" ("/" when empty); nullopt for any other path.
struct TokenPath {
  std::string_view token;
  std::string_view rest;
};
[[nodiscard]] std::optional<TokenPath> splitTokenPath(std::string_view path);
// "/m/ID/rest", likewise.
[[nodiscard]] std::optional<TokenPath> splitMissionPath(std::string_view path);
// The value of one cookie of a Cookie header.
[[nodiscard]] std::string_view cookie(std::string_view header, std::string_view name);

// A place in a bundle's bytes: the cursor before a record, and how many bytes of what follows it are there
// already, which count only as long as the next record is still that revision. Text: CURSOR or
// CURSOR+BYTES@REVISION.
struct BundlePlace {
  tiling::ChangeCursor cursor;
  std::uint64_t bytes = 0;
  std::uint64_t revision = 0;
};
[[nodiscard]] std::optional<BundlePlace> parseBundlePlace(const std::string& text);
[[nodiscard]] std::string text(const BundlePlace& place);

// "LAYER/Z/X/Y[+BYTES@REVISION];...": the tiles that a client asks for by name.
[[nodiscard]] std::optional<std::vector<WantedTile>> parseWanted(std::string_view text,
                                                                 std::size_t limit = 512);

// Constant in time over `presented`; false for an empty expected token.
[[nodiscard]] bool equalSecrets(std::string_view presented, std::string_view expected);

}  // namespace overfly::link
