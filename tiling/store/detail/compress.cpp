#include "tiling/store/detail/compress.h"

#include <fmt/format.h>
#include <zstd.h>

#include <algorithm>
#include <memory>

namespace overfly::tiling::detail {
namespace {

// A context is 100 kB to some MB and slow to make: one per thread.
ZSTD_CCtx* compressor() {
  thread_local const std::unique_ptr<ZSTD_CCtx, decltype(&ZSTD_freeCCtx)> context(ZSTD_createCCtx(),
                                                                                  &ZSTD_freeCCtx);
  return context.get();
}
ZSTD_DCtx* decompressor() {
  thread_local const std::unique_ptr<ZSTD_DCtx, decltype(&ZSTD_freeDCtx)> context(ZSTD_createDCtx(),
                                                                                  &ZSTD_freeDCtx);
  return context.get();
}

}  // namespace

Result<void> compress(std::span<const std::uint8_t> plain, int level, std::vector<std::uint8_t>& out) {
  // As long as what does not compress: kept for the next plane. Layers wait for the disk, in no more room
  // than they need.
  thread_local std::vector<std::uint8_t> room;
  room.resize(std::max(room.size(), ZSTD_compressBound(plain.size())));
  const std::size_t size =
      ZSTD_compressCCtx(compressor(), room.data(), room.size(), plain.data(), plain.size(), level);
  if (ZSTD_isError(size) != 0)
    return fail(ErrorCode::Internal, fmt::format("zstd: {}", ZSTD_getErrorName(size)));
  out.reserve(out.size() + size);
  out.insert(out.end(), room.data(), room.data() + size);
  return {};
}

Result<std::vector<std::uint8_t>> decompress(std::span<const std::uint8_t> packed, std::size_t most) {
  const unsigned long long size = ZSTD_getFrameContentSize(packed.data(), packed.size());
  if (size == ZSTD_CONTENTSIZE_ERROR || size == ZSTD_CONTENTSIZE_UNKNOWN || size > most)
    return fail(ErrorCode::Corrupt, "the compressed data has no plausible length");
  std::vector<std::uint8_t> plain(static_cast<std::size_t>(size));
  const std::size_t got =
      ZSTD_decompressDCtx(decompressor(), plain.data(), plain.size(), packed.data(), packed.size());
  if (ZSTD_isError(got) != 0 || got != plain.size())
    return fail(ErrorCode::Corrupt, "the compressed data does not unpack");
  return plain;
}

}  // namespace overfly::tiling::detail
