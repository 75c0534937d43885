#include "engine/ingest/image_sizes.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "engine/ingest/size_image.h"
#include "engine/plan/run_estimate.h"
#include "engine/shared/input_error.h"
#include "octree/mix.h"

namespace locvol {
namespace {

class NodeMaker {
 public:
  using Take = std::function<void(std::span<const SizedNode>)>;

  NodeMaker(const RunRecord& run, const Take& take)
      : law_(run.parameters.sizes()), frame_(run.frame), box_(run.surface.box), take_(take) {
    const Point sides = box_.max - box_.min;
    const double deepest = 0.5 * std::min({sides.x, sides.y, sides.z});
    most_ = std::min(law_.most, law_.surface + law_.growth * deepest);
  }

  void begin(const SizeImage& image) {
    image_ = image;
    side_ = std::min({image.spacing.x, image.spacing.y, image.spacing.z});
  }
  void add_slice(std::uint64_t k, std::span<const float> sizes) {
    for (std::uint64_t n = 0; n < sizes.size(); ++n)
      add(image_.voxel(n % image_.num[0], n / image_.num[0], k), sizes[n]);
    if (nodes_.size() < kPortion) return;
    unite(nodes_);
    if (nodes_.size() > kPortion / 2) hand_out();
  }
  void hand_out() {
    unite(nodes_);
    if (!nodes_.empty()) take_(nodes_);
    nodes_.clear();
  }

 private:
  static constexpr std::size_t kPortion = 1 << 20;

  void add(const Box& voxel, float size) {
    const double distance = std::sqrt(voxel.squared_distance(box_));
    const Box root = frame_.root_box();
    if (size + law_.growth * distance >= most_ || !voxel.overlaps(root)) return;
    const int level = frame_.level_no_wider(std::max(0.5 * side_, static_cast<double>(size)));
    std::array<std::uint32_t, 3> first{}, last{};
    for (const int axis : {0, 1, 2}) {
      const auto cell = [&](double v) {
        const double number = std::floor((v - root.min[axis]) / frame_.side(level));
        return static_cast<std::uint32_t>(std::clamp(number, 0.0, std::ldexp(1.0, level) - 1));
      };
      first[std::size_t(axis)] = cell(voxel.min[axis]);
      last[std::size_t(axis)] = cell(std::nextafter(voxel.max[axis], voxel.min[axis]));
    }
    const int shift = MortonKey::kMaxLevel - level;
    for (std::uint32_t z = first[2]; z <= last[2]; ++z)
      for (std::uint32_t y = first[1]; y <= last[1]; ++y)
        for (std::uint32_t x = first[0]; x <= last[0]; ++x) {
          const GridPoint low{x << shift, y << shift, z << shift};
          const SizedNode node{MortonKey::containing(low, level), size};
          if (nodes_.empty() || nodes_.back() != node) nodes_.push_back(node);
        }
  }

  SizeLaw law_;
  Frame frame_;
  Box box_;  // of the surface
  const Take& take_;
  double most_ = 0;  // that h is anywhere
  SizeImage image_;
  double side_ = 0;  // of a voxel, the least
  std::vector<SizedNode> nodes_;
};

}  // namespace

ImageFacts survey_size_image(const std::filesystem::path& file, const Box& box,
                             const StopToken* stop) {
  if (file.empty()) return {};
  SizeImage image;
  ImageFacts facts{.digest = {}, .least = std::numeric_limits<double>::infinity()};
  std::uint64_t hash = 0;
  double of_volume = 0;
  const auto note = [&](double v) { hash = mix(hash ^ std::bit_cast<std::uint64_t>(v)); };
  const auto see_header = [&](const SizeImage& header) {
    image = header;
    for (const int axis : {0, 1, 2}) {
      note(image.low[axis]), note(image.spacing[axis]);
      note(static_cast<double>(image.num[std::size_t(axis)]));
    }
  };
  const auto see_slice = [&](std::uint64_t k, std::span<const float> sizes) {
    for (std::uint64_t n = 0; n < sizes.size(); ++n) {
      const double size = sizes[n];
      note(size);
      facts.least = std::min(facts.least, size);
      const Box voxel = image.voxel(n % image.num[0], n / image.num[0], k);
      if (voxel.overlaps(box)) of_volume += voxel.common(box).volume() / std::pow(size, 3);
    }
  };
  read_size_image(file, {see_header, see_slice}, stop);
  const double num_cells = kGradedCells * of_volume;
  if (!(num_cells < kMostCells))
    throw InputError(fmt::format(
        "{}: its sizes, from {} on, ask for {:.2g} cells: give sizes {:.2g} times as large",
        file.string(), facts.least, num_cells, 1.01 * std::cbrt(num_cells / kMostCells)));
  facts.digest = fmt::format("{:016x}", hash);
  return facts;
}

void read_image_nodes(const std::filesystem::path& file, const RunRecord& run,
                      const std::function<void(std::span<const SizedNode>)>& take,
                      const StopToken* stop) {
  NodeMaker maker(run, take);
  read_size_image(
      file,
      {[&](const SizeImage& image) { maker.begin(image); },
       [&](std::uint64_t k, std::span<const float> sizes) { maker.add_slice(k, sizes); }},
      stop);
  maker.hand_out();
}

}  // namespace locvol
