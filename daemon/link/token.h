#pragma once
#include <filesystem>
#include <string>

#include "config/error.h"

namespace overfly::link {

// 258 random bits in URL-safe letters.
[[nodiscard]] std::string makeToken();
// Writes it whole or not at all, mode 0600; replaces an existing file.
[[nodiscard]] Result<void> writeToken(const std::filesystem::path& path, const std::string& token);

}  // namespace overfly::link
