#pragma once
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <tl/expected.hpp>
#include <vector>

#include "config/error.h"
#include "config/settings.h"

// Settings from files, environment and command line, in this order, later ones over earlier ones:
//   1. /etc/overfly/overfly.toml, when it exists
//   2. /etc/overfly/conf.d/*.toml, in the order of their names
//   3. the environment, OVERFLY_SECTION_KEY (OVERFLY_SWEEP_MAX_AGE_S is sweep.max_age_s)
//   4. --set section.key=value
// Everything is checked against config/description.h. Reentrant; reads the file system only where a path says
// so.
namespace overfly::config {

// Where a value came from.
struct Origin {
  std::string source;  // path of the file, "environment OVERFLY_…", "--set …", or empty for a default
  int line = 0;        // from 1; 0: the source has no lines
};

struct Problem {
  Origin origin;
  std::string key;      // "section.key", "[section]", or empty when it is about the whole source
  std::string message;  // what was found, what is allowed

  // "overfly.toml:12: sweep.planes: found 3, allowed a whole number from 8 to 1024"
  [[nodiscard]] std::string text() const;
};
using Problems = std::vector<Problem>;

struct Sources {
  std::vector<std::filesystem::path> files;                      // in order; each must exist
  std::vector<std::pair<std::string, std::string>> environment;  // all of it; what is not ours is passed over
  std::vector<std::string> overrides;                            // "section.key=value"
};

// The files of an installation that exist below `etc`, and the environment of this process.
// `only_file` replaces all of them when the user names one.
[[nodiscard]] Sources installedSources(const std::filesystem::path& etc = "/etc/overfly",
                                       const std::optional<std::filesystem::path>& only_file = std::nullopt);

struct Loaded {
  Settings settings;
  std::map<std::string, Origin> origins;  // of every key that is not at its default, by "section.key"
};

// All sources in order, or every problem in all of them (by source, then line).
[[nodiscard]] tl::expected<Loaded, Problems> load(const Sources& sources);

// One file's text alone over the defaults; `name` stands in the messages.
[[nodiscard]] tl::expected<Loaded, Problems> loadText(std::string_view toml, const std::string& name);

// The problems as one error, one line each, of code BadSettings (exit status 2).
[[nodiscard]] Error errorFrom(const Problems& problems);

}  // namespace overfly::config
