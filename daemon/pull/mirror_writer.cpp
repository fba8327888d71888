#include "daemon/pull/mirror_writer.h"

namespace overfly::pull {
namespace {

using namespace std::chrono_literals;
constexpr std::uint64_t kCommitBytes = 4u << 20, kMostBytes = 16u << 20;
constexpr auto kCommitAge = 500ms, kRetry = 1000ms;

}  // namespace

void MirrorWriter::open(std::unique_ptr<Mirror> mirror) {
  close();
  mirror_ = std::move(mirror);
}

void MirrorWriter::close() {
  mirror_.reset();
  pending_ = {};
  pending_bytes_ = 0;
  retry_at_ = {};
}

void MirrorWriter::keep(link::TileRecord record) {
  if (pending_.records.empty()) since_ = Clock::now();
  for (const auto& layer : record.layers) pending_bytes_ += layer.encoded.bytes.size();
  pending_.records.push_back(std::move(record));
}

bool MirrorWriter::isFull() const { return pending_bytes_ >= kMostBytes; }

bool MirrorWriter::isDue(bool idle) const {
  const auto now = Clock::now();
  if (!mirror_ || now < retry_at_) return false;
  if (pending_.records.empty()) return pending_.cursor.has_value();
  return idle || now - since_ >= kCommitAge || pending_bytes_ >= kCommitBytes;
}

Result<bool> MirrorWriter::commit() {
  if (!mirror_ || (pending_.records.empty() && !pending_.cursor)) return false;
  if (const auto done = mirror_->commit(pending_); !done) {
    retry_at_ = Clock::now() + kRetry;
    return tl::unexpected(done.error());
  }
  pending_ = {};
  pending_bytes_ = 0;
  return true;
}

}  // namespace overfly::pull
