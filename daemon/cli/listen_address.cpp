#include "daemon/cli/listen_address.h"

namespace overfly::cli {

Result<void> applyAddress(const std::string& text, config::Link& link) {
  auto host = text;
  if (const auto colon = text.rfind(':');
      colon != std::string::npos && text.find(']', colon) == std::string::npos) {
    host = text.substr(0, colon);
    const auto digits = text.substr(colon + 1);
    if (digits.empty() || digits.size() > 5 || digits.find_first_not_of("0123456789") != std::string::npos ||
        std::stoi(digits) > 65535)
      return fail(ErrorCode::BadSettings, "\"" + text + "\" is not ADDRESS:PORT");
    link.port = std::stoi(digits);
  }
  if (host.size() > 2 && host.front() == '[') host = host.substr(1, host.size() - 2);
  if (!host.empty()) link.listen = host;
  return {};
}

}  // namespace overfly::cli
