#pragma once
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "config/settings.h"

namespace overfly::link {

// What the link's server needs to know; filled from the settings' [link] section by the daemon.
struct LinkOptions {
  std::string address = "127.0.0.1";  // IPv4 or IPv6 literal; "::" or "0.0.0.0": every interface
  std::uint16_t port = 8420;          // 0: the system chooses (LinkServer::port() says which)

  std::string token_file;            // empty: no token; the file must be readable by its owner alone
  bool allow_without_token = false;  // beyond loopback a token is required unless this is set
  std::string tls_certificate_file;  // both or neither; PEM
  std::string tls_key_file;
  std::vector<std::string> cors_origins;  // exact origins; "*" is refused together with a token

  double max_kbps = 0;  // cap over all clients, 1000 bit/s of payload and headers; 0: none

  // Beyond either, whoever has waited longest without a request is dropped for the newcomer.
  unsigned max_connections = 1024;
  unsigned max_connections_per_address = 256;
  std::size_t max_request_header_bytes = 16 * 1024;
  std::size_t max_body_bytes = 1024 * 1024;  // PUT /plan
  double header_time_s = 10;                 // from a connection's start to its first whole request
  double idle_time_s = 60;                   // between two requests on a kept connection
  double stall_time_s = 60;  // a client that takes less than one block in this time is dropped
  unsigned workers = 2;      // threads that read and render tiles

  int coverage_views = 3;  // that must see a place for it to count as covered, unless a client says otherwise
  double event_heartbeat_s = 15;
  std::size_t max_bundle_bytes = 1024 * 1024;  // largest part of one /bundle or /changes answer
  int overzoom = 4;                            // zooms beyond the map's own that are composed, each way
};

// The settings' view of it. On loopback no token is asked for; beyond it one is, unless link.require_token is
// off.
[[nodiscard]] LinkOptions optionsFrom(const config::Link& settings);

// 127.0.0.0/8 or ::1.
[[nodiscard]] bool isLoopback(const std::string& address);

}  // namespace overfly::link
