// VertexCache keeps the blocks of a long list of vertices that were asked for last.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "octree/geometry.h"

namespace locvol {

// Each block has one place. Memory: 25 MB, once it is used.
class VertexCache {
 public:
  static constexpr std::size_t kBlockVertices = 128;

  // load(number, vertices): reads the block, the last one as far as there are vertices.
  template <class Load>
  const Point& at(std::uint64_t vertex, const Load& load) {
    if (blocks_.empty()) blocks_.resize(kBlocks);
    const std::uint64_t number = vertex / kBlockVertices;
    Block& block = blocks_[number % kBlocks];
    if (block.number != number) {
      load(number, std::span(block.vertices));
      block.number = number;
    }
    return block.vertices[vertex % kBlockVertices];
  }

 private:
  static constexpr std::size_t kBlocks = 8192;

  struct Block {
    std::uint64_t number = ~std::uint64_t{0};
    std::array<Point, kBlockVertices> vertices;
  };

  std::vector<Block> blocks_;
};

}  // namespace locvol
