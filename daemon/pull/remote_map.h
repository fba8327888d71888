#pragma once
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>

#include "daemon/pull/mirror.h"

// What the drone's documents say, as values. Nothing in them is trusted: what does not fit is an error or
// passed over.
namespace overfly::pull {

// Of /tiles.json. Unsupported: not an overfly link, or one too old to be mirrored.
[[nodiscard]] Result<RemoteMap> parseRemoteMap(const std::string& text);

struct ChangeLine {
  Listed listed;
  bool erased = false;
  bool unwrapped = false;  // x lies outside [0, 2^zoom)
};
// One line of /changes; nullopt: none that is known here.
[[nodiscard]] std::optional<ChangeLine> parseChange(const std::string& line);

// One of an event's [layer, zoom, x, y, revision].
[[nodiscard]] std::optional<Listed> parseEventTile(const nlohmann::json& tile);

}  // namespace overfly::pull
