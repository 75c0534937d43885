// An image of sizes becomes nodes of the octree with the sizes that it asks for in them.
#pragma once

#include <filesystem>
#include <functional>
#include <span>

#include "engine/plan/options.h"
#include "octree/geometry.h"
#include "octree/size_nodes.h"
#include "octree/stop.h"
#include "storage/records.h"

namespace locvol {

// Reads all of it; of none, if `file` is empty. Throws InputError as read_size_image(), and where
// it asks for more cells in the surface's `box` than anyone could want; Stopped.
ImageFacts survey_size_image(const std::filesystem::path& file, const Box& box,
                             const StopToken* stop = nullptr);

// Finds nodes of the octree that cover each voxel, with its value. They are at least half as wide
// as the voxel, or about as wide as the value, if that is more. What can matter nowhere in the
// surface's box is left out. take() gets them in portions, united.
void read_image_nodes(const std::filesystem::path& file, const RunRecord& run,
                      const std::function<void(std::span<const SizedNode>)>& take,
                      const StopToken* stop = nullptr);

}  // namespace locvol
