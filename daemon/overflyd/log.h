#pragma once
#include <string>

#include "config/settings.h"

namespace overfly::daemon {

// Sends the log to stderr. Where that is the journal's pipe, each line begins with the level that journald
// understands ("<4>"); else with its name. Once, before other threads run.
void startLog(config::LogLevel level);
// From any thread.
void setLogLevel(config::LogLevel level);

// What may come in swarms (bad frames, say): a warning of each kind once a minute, with how many more there
// were meanwhile. Thread-safe.
void warnOnce(const std::string& kind, const std::string& message);

}  // namespace overfly::daemon
