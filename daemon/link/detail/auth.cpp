#include "daemon/link/detail/auth.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cerrno>
#include <cstring>

#include "daemon/link/detail/parse.h"

namespace overfly::link {
namespace {

// A page of another site that has made its own name point here (DNS rebinding) still sends that name; with
// no token to ask for, only addresses and this machine's own names are answered.
bool hostIsOwn(std::string_view host) {
  if (host.empty()) return true;  // HTTP/1.0 tools; browsers always send it
  if (host.front() == '[') return true;
  host = host.substr(0, host.rfind(':') == std::string_view::npos ? host.size() : host.rfind(':'));
  in_addr v4{};
  if (inet_pton(AF_INET, std::string(host).c_str(), &v4) == 1) return true;
  if (host == "localhost" || host.ends_with(".localhost")) return true;
  std::array<char, 256> name{};
  if (gethostname(name.data(), name.size() - 1) != 0) return false;
  const std::string own(name.data());
  return host == own || host == own + ".local" || host.starts_with(own + ".");
}

// "http://HOST[:PORT]" is what the request itself came to.
bool sameOrigin(std::string_view origin, std::string_view host) {
  const auto at = origin.find("://");
  return at != std::string_view::npos && origin.substr(at + 3) == host;
}

Result<std::string> readToken(const std::string& path) {
  const int fd = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (fd < 0)
    return fail(ErrorCode::BadSettings, "cannot read link.token_file " + path + ": " + std::strerror(errno) +
                                            "; make one with `overfly token new`");
  struct stat info {};
  std::array<char, 512> text{};
  const bool open_to_others = fstat(fd, &info) != 0 || (info.st_mode & 077) != 0;
  const auto size = read(fd, text.data(), text.size());
  close(fd);
  if (open_to_others)
    return fail(ErrorCode::BadSettings, "link.token_file " + path + " can be read by others; chmod 600 it");
  std::string token(text.data(), static_cast<std::size_t>(std::max<ssize_t>(size, 0)));
  while (!token.empty() && (token.back() == '\n' || token.back() == '\r' || token.back() == ' '))
    token.pop_back();
  const bool clean =
      std::ranges::all_of(token, [](unsigned char c) { return std::isalnum(c) || c == '-' || c == '_'; });
  if (token.size() < 16 || !clean)
    return fail(ErrorCode::BadSettings,
                "link.token_file " + path +
                    " does not hold a token of at least 16 letters, digits, '-' or '_'; "
                    "make one with `overfly token new`");
  return token;
}

}  // namespace

Result<Access> Access::load(const LinkOptions& options) {
  Access out;
  out.origins_ = options.cors_origins;
  if (!options.token_file.empty()) {
    auto token = readToken(options.token_file);
    if (!token) return tl::unexpected(token.error());
    out.token_ = std::move(*token);
  } else if (!isLoopback(options.address) && !options.allow_without_token) {
    return fail(
        ErrorCode::BadSettings,
        "link.address " + options.address +
            " can be reached from other machines, so link.token_file is needed: make one with `overfly "
            "token new`, or set link.allow_without_token");
  }
  if (options.tls_certificate_file.empty() != options.tls_key_file.empty())
    return fail(ErrorCode::BadSettings, "link.tls_certificate and link.tls_key go together; one is missing");
  if (out.hasToken() && std::ranges::find(out.origins_, "*") != out.origins_.end())
    return fail(ErrorCode::BadSettings,
                "link.cors_origins \"*\" would let every web page use a token; name the origins");
  return out;
}

std::optional<Response> Access::refuse(Request& request) const {
  if (token_.empty()) {
    if (!hostIsOwn(request.header("host")))
      return Response::text(421, "This server does not answer to that host name.\n");
    // Without a token nothing else tells a foreign page's POST from the operator's.
    const auto origin = request.header("origin");
    const bool changes = request.method != Method::Get;
    if (changes && !origin.empty() && !sameOrigin(origin, request.header("host")) &&
        std::ranges::find(origins_, origin) == origins_.end())
      return Response::text(403, "A page of another site may not change anything here.\n");
    return std::nullopt;
  }
  bool known = false;
  if (const auto split = splitTokenPath(request.path)) {
    known = equalSecrets(split->token, token_);
    if (known) {
      request.prefix = "/t/" + std::string(split->token);
      request.path = std::string(split->rest);
    }
  }
  constexpr std::string_view kBearer = "Bearer ";
  const auto authorization = request.header("authorization");
  if (!known && authorization.starts_with(kBearer))
    known = equalSecrets(std::string_view(authorization).substr(kBearer.size()), token_);
  if (!known) known = equalSecrets(cookie(request.header("cookie"), "overfly_token"), token_);
  if (known) return std::nullopt;
  auto refusal =
      Response::text(401, "A token is needed: Authorization: Bearer TOKEN, or the path /t/TOKEN/...\n");
  refusal.headers.emplace_back("WWW-Authenticate", "Bearer");
  return refusal;
}

void Access::addCors(const Request& request, Response& response) const {
  const auto origin = request.header("origin");
  if (origin.empty()) return;
  for (const auto& allowed : origins_) {
    if (allowed != "*" && allowed != origin) continue;
    response.headers.emplace_back("Access-Control-Allow-Origin", allowed);
    response.headers.emplace_back("Access-Control-Expose-Headers", "ETag, Overfly-Cursor, Overfly-Revision");
    response.headers.emplace_back("Vary", "Origin");
    return;
  }
}

}  // namespace overfly::link
