#include "daemon/pull/record_stream.h"

#include <algorithm>

namespace overfly::pull {
namespace {

constexpr std::string_view kMagic = "OFT1";
constexpr std::size_t kLayerAt = link::kRecordHead;  // the first layer's number

bool mayBeHead(std::string_view bytes) {
  const auto known = std::min(bytes.size(), kMagic.size());
  return bytes.substr(0, known) == kMagic.substr(0, known);
}

}  // namespace

// Puts what is here already of the record that begins now before its rest. False: too little has come to tell
// whether it goes on or comes anew; the middle of a record that looks like a head by chance is caught by the
// checksum.
bool RecordStream::atRecord() {
  if (inside_ || begun_.empty()) return inside_ = true;
  if (mayBeHead(rest_)) {
    if (rest_.size() <= kLayerAt) return false;
    const auto head = link::recordHead(rest_);
    const auto layer = static_cast<tiling::Layer>(rest_[kLayerAt]);
    // Changed since, or one of those that were asked for whole.
    std::erase_if(begun_, [&](const Begun& one) { return one.what == LayerKey{head->key, layer}; });
  } else {
    rest_.insert(0, begun_.front().bytes);
    resumed_ += begun_.front().bytes.size();
    begun_.pop_front();
  }
  return inside_ = true;
}

Result<std::vector<link::TileRecord>> RecordStream::feed(std::string_view bytes) {
  std::vector<link::TileRecord> out;
  rest_ += bytes;
  while (!rest_.empty() && atRecord()) {
    const auto length = link::recordLength(rest_);
    if (!length) return tl::unexpected(length.error());
    if (!*length || **length > rest_.size()) break;
    auto record = link::decodeRecord(std::string_view(rest_).substr(0, **length));
    if (!record) return tl::unexpected(record.error());
    out.push_back(std::move(*record));
    rest_.erase(0, **length);
    inside_ = false;
  }
  return out;
}

std::vector<Begun> RecordStream::parts() const {
  std::vector<Begun> out(begun_.begin(), begun_.end());
  if (inside_ && rest_.size() > kLayerAt)
    if (const auto head = link::recordHead(rest_))
      out.push_back({{head->key, static_cast<tiling::Layer>(rest_[kLayerAt])}, head->revision, rest_});
  return out;
}

}  // namespace overfly::pull
