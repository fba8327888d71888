#include "capture/pose/mavlink/signer.h"

#include <fmt/format.h>
#include <openssl/evp.h>

#include <cctype>
#include <memory>
#include <string>

#include "capture/record/files.h"

namespace overfly::mavlink {
namespace {

constexpr std::int64_t kEpoch_us = 1'420'070'400'000'000;  // 2015-01-01 UTC
constexpr std::uint64_t kMinute = 6'000'000;               // 10 us
constexpr std::size_t kMaxStreams = 256;

std::optional<int> hexDigit(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  if (c >= 'A' && c <= 'F') return c - 'A' + 10;
  return std::nullopt;
}

}  // namespace

Result<Key> readKey(const std::filesystem::path& file) {
  const auto bytes = capture::readFile(file, 4096);
  if (!bytes) return tl::unexpected(bytes.error());
  Key key{};
  if (bytes->size() == key.size()) {
    std::copy(bytes->begin(), bytes->end(), key.begin());
    return key;
  }
  std::string digits;
  for (const std::uint8_t byte : *bytes)
    if (std::isspace(byte) == 0) digits += static_cast<char>(byte);
  bool good = digits.size() == 2 * key.size();
  for (std::size_t i = 0; good && i < key.size(); ++i) {
    const auto high = hexDigit(digits[2 * i]), low = hexDigit(digits[2 * i + 1]);
    good = high && low;
    if (good) key[i] = static_cast<std::uint8_t>(*high << 4 | *low);
  }
  if (!good) {
    return fail(
        ErrorCode::BadSettings,
        fmt::format("{} is no signing key: it must hold 32 bytes or 64 hexadecimal digits", file.string()));
  }
  return key;
}

void Signer::sign(std::vector<std::uint8_t>& packet, std::int64_t unix_us) {
  const auto now = static_cast<std::uint64_t>(std::max<std::int64_t>(unix_us - kEpoch_us, 0)) / 10;
  time_ = std::max(time_ + 1, now);
  packet.push_back(link_);
  for (int byte = 0; byte < 6; ++byte) packet.push_back(static_cast<std::uint8_t>(time_ >> (8 * byte)));
  const auto end = digest(packet);
  packet.insert(packet.end(), end.begin(), end.end());
}

Signer::Verdict Signer::verify(const Packet& packet, std::span<const std::uint8_t> raw) {
  if (!packet.has_signature) return Verdict::Unsigned;
  const auto signature = raw.last(kSignature);
  if (const auto right = digest(raw.first(raw.size() - 6));
      !std::equal(right.begin(), right.end(), signature.begin() + 7)) {
    return Verdict::WrongKey;
  }
  std::uint64_t time = 0;
  for (std::size_t byte = 0; byte < 6; ++byte) time |= std::uint64_t{signature[1 + byte]} << (8 * byte);
  const Stream stream{packet.from, signature[0]};
  const auto known = last_.find(stream);
  if (known != last_.end() ? time <= known->second : time + kMinute < time_) return Verdict::Replayed;
  if (known == last_.end() && last_.size() >= kMaxStreams) return Verdict::Replayed;
  last_[stream] = time;
  time_ = std::max(time_, time);
  return Verdict::Good;
}

std::array<std::uint8_t, 6> Signer::digest(std::span<const std::uint8_t> without_digest) const {
  const std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)> context(EVP_MD_CTX_new(), EVP_MD_CTX_free);
  std::array<std::uint8_t, EVP_MAX_MD_SIZE> hash{};
  EVP_DigestInit_ex(context.get(), EVP_sha256(), nullptr);
  EVP_DigestUpdate(context.get(), key_.data(), key_.size());
  EVP_DigestUpdate(context.get(), without_digest.data(), without_digest.size());
  EVP_DigestFinal_ex(context.get(), hash.data(), nullptr);
  std::array<std::uint8_t, 6> first{};
  std::copy_n(hash.begin(), first.size(), first.begin());
  return first;
}

}  // namespace overfly::mavlink
