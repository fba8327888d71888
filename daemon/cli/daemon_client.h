#pragma once
#include <string>

#include "daemon/cli/command.h"

namespace overfly::cli {

// A daemon's link, as the commands that talk to it see it.
struct DaemonAddress {
  std::string url;      // without a slash at its end; may hold /t/TOKEN
  std::string token;    // empty: none is shown
  std::string ca_file;  // PEM to trust; empty: the system's
};

// The daemon that `url` names, or, when it is empty, the one of this machine's settings with its token.
[[nodiscard]] Result<DaemonAddress> daemonOf(const Context& context, const std::string& url);

// One request; the answer's body. Unavailable: no daemon answers. BadSettings: it asks for a token. BadInput:
// it refuses, with its reason.
[[nodiscard]] Result<std::string> askDaemon(const DaemonAddress& daemon, const std::string& method,
                                            const std::string& path, const std::string& body = {});

}  // namespace overfly::cli
