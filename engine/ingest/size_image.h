// A VTK image (XML ImageData, .vti) whose one scalar array is a field of sizes (`--sizes
// FILE.vti`).
//
//   <VTKFile type="ImageData" version="1.0" byte_order="LittleEndian" header_type="UInt64">
//     <ImageData WholeExtent="0 9 0 9 0 4" Origin="0 0 0" Spacing="0.5 0.5 1">
//       <Piece Extent="0 9 0 9 0 4">
//         <PointData Scalars="size">
//           <DataArray type="Float32" Name="size" format="appended" offset="0"/> ...
//
// A size is a length in the units of the coordinates. Of the ways in which VTK writes an array, all
// are read but compression by LZ4 and LZMA. Of several arrays with one component, the sizes are the
// one that the attribute Scalars names, or else the one named "size" or "h".
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <span>

#include "octree/geometry.h"
#include "octree/stop.h"

namespace locvol {

// What the image says of itself. Each value has a voxel: its cell, or, of point data, the box
// around its point, which reaches halfway to the next points. Along an axis with one point only,
// that is the voxel of cell data too.
struct SizeImage {
  std::array<std::uint64_t, 3> num{};  // of values along each axis, 1 or more
  Point low;                           // lower corner of the first value's voxel
  Point spacing;                       // sides of a voxel, above 0

  std::uint64_t num_values() const { return num[0] * num[1] * num[2]; }
  // Neighbors share their sides to the bit.
  Box voxel(std::uint64_t i, std::uint64_t j, std::uint64_t k) const;
};

struct SizeImageSink {
  std::function<void(const SizeImage&)> on_header;  // once, before the slices
  // It is called for each k, ascending, with num[0] * num[1] sizes, finite and above 0, x fastest.
  std::function<void(std::uint64_t k, std::span<const float> sizes)> on_slice;
};

// Holds one slice and what VtkValues does; files without appended data are read twice. Throws
// InputError, which names the place: no VTK image; one with several pieces, turned, or without
// volume; more than 2^28 values in a slice; no array to choose, or several; an array that is
// damaged, or shorter or longer than the extent; a size that is no finite number above 0, as a
// float. Throws Stopped.
void read_size_image(const std::filesystem::path& path, const SizeImageSink& sink,
                     const StopToken* stop = nullptr);

}  // namespace locvol
