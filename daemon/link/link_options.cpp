#include "daemon/link/link_options.h"

#include <arpa/inet.h>

namespace overfly::link {

bool isLoopback(const std::string& address) {
  in_addr v4{};
  if (inet_pton(AF_INET, address.c_str(), &v4) == 1) return (ntohl(v4.s_addr) >> 24) == 127;
  return address == "::1";
}

LinkOptions optionsFrom(const config::Link& settings) {
  LinkOptions out;
  out.address = settings.listen;
  out.port = static_cast<std::uint16_t>(settings.port);
  out.max_kbps = settings.max_kbps;
  out.max_connections = static_cast<unsigned>(settings.max_connections);
  out.max_connections_per_address = out.max_connections;
  out.max_body_bytes = static_cast<std::size_t>(settings.max_request_kb) * 1024;
  out.header_time_s = settings.header_timeout_s;
  out.stall_time_s = settings.send_timeout_s;
  out.idle_time_s = settings.send_timeout_s;
  out.allow_without_token = !settings.require_token;
  if (settings.require_token && !isLoopback(settings.listen)) out.token_file = settings.token_file.string();
  out.tls_certificate_file = settings.tls_certificate.string();
  out.tls_key_file = settings.tls_key.string();
  out.cors_origins = settings.allowed_origins;
  return out;
}

}  // namespace overfly::link
