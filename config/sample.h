#pragma once
#include <string>

#include "config/settings.h"

namespace overfly::config {

// The settings as a commented TOML file: every key with its meaning, what it takes and its value. A key at
// its default is commented out, so that the file of a new installation changes nothing and follows new
// defaults.
[[nodiscard]] std::string sampleText(const Settings& settings);

}  // namespace overfly::config
