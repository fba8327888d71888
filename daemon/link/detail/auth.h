#pragma once
#include <optional>
#include <string>

#include "config/error.h"
#include "daemon/link/detail/http_server.h"
#include "daemon/link/link_options.h"

namespace overfly::link {

// Who may talk to the link. The token comes as "Authorization: Bearer TOKEN", as the path prefix /t/TOKEN/
// or as the cookie overfly_token; it is compared in constant time and appears in no log. Immutable after
// load: reentrant.
class Access {
 public:
  // BadSettings: a token file that others can read, or none although the address is not loopback.
  [[nodiscard]] static Result<Access> load(const LinkOptions& options);

  // The refusal, or nothing. Strips the path's token prefix into request.prefix.
  [[nodiscard]] std::optional<Response> refuse(Request& request) const;
  [[nodiscard]] bool hasToken() const { return !token_.empty(); }
  // "/t/TOKEN", or nothing without a token.
  [[nodiscard]] std::string tokenPath() const { return token_.empty() ? std::string() : "/t/" + token_; }
  // CORS headers for an allowed origin; adds nothing otherwise.
  void addCors(const Request& request, Response& response) const;

 private:
  std::string token_;
  std::vector<std::string> origins_;
};

}  // namespace overfly::link
