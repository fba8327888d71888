#pragma once
#include <string>

#include "config/error.h"
#include "config/settings.h"

namespace overfly::cli {

// "HOST:PORT", "[V6]:PORT", ":PORT" or "HOST" over what the settings say. BadSettings: none of these.
[[nodiscard]] Result<void> applyAddress(const std::string& text, config::Link& link);

}  // namespace overfly::cli
