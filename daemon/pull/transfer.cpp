#include "daemon/pull/transfer.h"

#include <curl/curl.h>

#include <algorithm>
#include <cctype>
#include <cstdint>
#include <set>

namespace overfly::pull {
namespace {

using Clock = std::chrono::steady_clock;

struct Running {
  Transfers::Call call;
  TransferEnd end;
  CURL* curl = nullptr;
  curl_slist* headers = nullptr;
  Clock::time_point last_byte = Clock::now();
  std::uint64_t* bytes = nullptr;
};

std::size_t onData(char* data, std::size_t, std::size_t size, void* to) {
  auto& running = *static_cast<Running*>(to);
  running.last_byte = Clock::now();
  *running.bytes += size;
  // An error's text is not the data that was asked for.
  long status = 0;
  curl_easy_getinfo(running.curl, CURLINFO_RESPONSE_CODE, &status);
  if (status == 200 && running.call.data) running.call.data({data, size});
  return size;
}

std::size_t onHeader(char* data, std::size_t, std::size_t size, void* to) {
  auto& running = *static_cast<Running*>(to);
  running.last_byte = Clock::now();
  const std::string_view line(data, size);
  const auto colon = line.find(':');
  if (colon == std::string_view::npos) return size;
  std::string name(line.substr(0, colon)), value(line.substr(colon + 1));
  std::ranges::transform(name, name.begin(),
                         [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  const auto blank = [](char c) { return std::isspace(static_cast<unsigned char>(c)) != 0; };
  while (!value.empty() && blank(value.front())) value.erase(0, 1);
  while (!value.empty() && blank(value.back())) value.pop_back();
  running.end.headers[name] = value;
  return size;
}

// libcurl's global state, once in the program.
void initialiseOnce() {
  static const CURLcode done = curl_global_init(CURL_GLOBAL_DEFAULT);
  (void)done;
}

}  // namespace

struct Transfers::Impl {
  TransferOptions options;
  CURLM* multi = nullptr;
  std::set<Running*> all;
  std::uint64_t bytes = 0, connections = 0;

  void finish(Running* running, CURLcode code) {
    all.erase(running);
    long made = 0;
    curl_easy_getinfo(running->curl, CURLINFO_NUM_CONNECTS, &made);
    connections += static_cast<std::uint64_t>(made);
    curl_easy_getinfo(running->curl, CURLINFO_RESPONSE_CODE, &running->end.status);
    running->end.whole = code == CURLE_OK;
    if (code != CURLE_OK && running->end.problem.empty()) running->end.problem = curl_easy_strerror(code);
    curl_multi_remove_handle(multi, running->curl);
    curl_easy_cleanup(running->curl);
    curl_slist_free_all(running->headers);
    const std::unique_ptr<Running> owned(running);
    if (owned->call.end) owned->call.end(owned->end);
  }
};

Transfers::Transfers(TransferOptions options) : impl_(std::make_unique<Impl>()) {
  initialiseOnce();
  impl_->options = std::move(options);
  impl_->multi = curl_multi_init();
  curl_multi_setopt(impl_->multi, CURLMOPT_MAX_TOTAL_CONNECTIONS,
                    static_cast<long>(impl_->options.connections));
  curl_multi_setopt(impl_->multi, CURLMOPT_MAXCONNECTS, static_cast<long>(impl_->options.connections));
  curl_multi_setopt(impl_->multi, CURLMOPT_PIPELINING, static_cast<long>(CURLPIPE_NOTHING));
}

Transfers::~Transfers() {
  for (Running* running : impl_->all) {
    curl_multi_remove_handle(impl_->multi, running->curl);
    curl_easy_cleanup(running->curl);
    curl_slist_free_all(running->headers);
    delete running;
  }
  curl_multi_cleanup(impl_->multi);
}

void Transfers::start(Call call) {
  auto owned = std::make_unique<Running>();
  Running* running = owned.get();
  running->call = std::move(call);
  running->bytes = &impl_->bytes;
  running->curl = curl_easy_init();
  CURL* curl = running->curl;
  for (const auto& header : running->call.headers)
    running->headers = curl_slist_append(running->headers, header.c_str());
  if (!impl_->options.token.empty())
    running->headers =
        curl_slist_append(running->headers, ("Authorization: Bearer " + impl_->options.token).c_str());
  curl_easy_setopt(curl, CURLOPT_URL, running->call.url.c_str());
  curl_easy_setopt(curl, CURLOPT_PROTOCOLS_STR, "http,https");
  curl_easy_setopt(curl, CURLOPT_HTTP_VERSION, static_cast<long>(CURL_HTTP_VERSION_1_1));
  curl_easy_setopt(curl, CURLOPT_HTTPHEADER, running->headers);
  curl_easy_setopt(curl, CURLOPT_NOSIGNAL, 1L);
  curl_easy_setopt(curl, CURLOPT_TCP_KEEPALIVE, 1L);
  curl_easy_setopt(curl, CURLOPT_CONNECTTIMEOUT_MS, static_cast<long>(impl_->options.connect_time_s * 1000));
  if (!impl_->options.ca_file.empty()) curl_easy_setopt(curl, CURLOPT_CAINFO, impl_->options.ca_file.c_str());
  curl_easy_setopt(curl, CURLOPT_WRITEFUNCTION, &onData);
  curl_easy_setopt(curl, CURLOPT_WRITEDATA, running);
  curl_easy_setopt(curl, CURLOPT_HEADERFUNCTION, &onHeader);
  curl_easy_setopt(curl, CURLOPT_HEADERDATA, running);
  curl_easy_setopt(curl, CURLOPT_PRIVATE, running);
  curl_multi_add_handle(impl_->multi, curl);
  impl_->all.insert(owned.release());
}

std::size_t Transfers::running() const { return impl_->all.size(); }

void Transfers::run(std::chrono::milliseconds at_most) {
  auto& self = *impl_;
  int handles = 0;
  curl_multi_perform(self.multi, &handles);
  curl_multi_poll(self.multi, nullptr, 0, static_cast<int>(at_most.count()), nullptr);
  curl_multi_perform(self.multi, &handles);
  for (;;) {
    int left = 0;
    const CURLMsg* message = curl_multi_info_read(self.multi, &left);
    if (message == nullptr) break;
    if (message->msg != CURLMSG_DONE) continue;
    const CURLcode code = message->data.result;
    Running* running = nullptr;
    curl_easy_getinfo(message->easy_handle, CURLINFO_PRIVATE, &running);
    self.finish(running, code);
  }
  const auto now = Clock::now();
  std::vector<Running*> stalled;
  for (Running* running : self.all)
    if (std::chrono::duration<double>(now - running->last_byte).count() > running->call.stall_time_s)
      stalled.push_back(running);
  for (Running* running : stalled) {
    running->end.problem = "nothing came for some seconds";
    self.finish(running, CURLE_OPERATION_TIMEDOUT);
  }
}

void Transfers::wake() { curl_multi_wakeup(impl_->multi); }

std::uint64_t Transfers::bytes() const { return impl_->bytes; }
std::uint64_t Transfers::connections() const { return impl_->connections; }

std::string percentEncoded(std::string_view text) {
  static constexpr std::string_view kDigits = "0123456789ABCDEF";
  std::string out;
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    if (std::isalnum(byte) || c == '-' || c == '.' || c == '_' || c == '~' || c == '/' || c == ';' ||
        c == '@' || c == ',') {
      out += c;
    } else {
      out += '%';
      out += kDigits[byte >> 4];
      out += kDigits[byte & 15];
    }
  }
  return out;
}

}  // namespace overfly::pull
