#pragma once
#include <cstdint>
#include <string>

#include "daemon/link/detail/raster.h"

// Image files in memory. All functions are reentrant.
namespace overfly::link {

[[nodiscard]] std::string encodePng(const Rgba& image);                // RGBA, lossless
[[nodiscard]] std::string encodeWebp(const Rgba& image, int quality);  // quality 0..100; above 100: lossless
[[nodiscard]] std::string encodeJpeg(const Rgba& image, int quality);  // no-data becomes white

// Terrarium: height = R * 256 + G + B / 256 - 32768 metres (steps of 4 mm), opaque. No-data takes the mean
// of its nearest neighbours with data, or `fill_m` in a tile without any: viewers of this format know no
// holes.
[[nodiscard]] Rgba terrarium(const Heights& heights, float fill_m);

// Float32 GeoTIFF in EPSG:3857, NaN as GDAL_NODATA; (west, north) is the outer corner in metres, `texel_m`
// the texel's side there. Uncompressed: a reader of one strip needs no library.
[[nodiscard]] std::string encodeGeoTiff(const Heights& heights, double west_m, double north_m,
                                        double texel_m);

}  // namespace overfly::link
