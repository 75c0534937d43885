#include <array>
#include <bit>
#include <optional>
#include <ranges>
#include <span>
#include <vector>

#include "engine/formats/formats.h"
#include "engine/formats/outputs.h"

namespace locvol {
namespace {

static_assert(std::endian::native == std::endian::little, "written as the machine has it");

constexpr std::int32_t kTriangle = 2, kTetrahedron = 4;  // Gmsh's types of elements
constexpr std::int32_t kSurface = 1, kVolume = 1;        // entities
constexpr std::int32_t kBoundaryGroup = 1, kVolumeGroup = 2;

constexpr std::string_view kGroups =
    "$PhysicalNames\n2\n2 1 \"boundary\"\n3 2 \"volume\"\n$EndPhysicalNames\n";

// "4.1 1 8": binary, and the size of a double; 1 as an integer tells the order of bytes.
void add_format(std::string_view version, Bytes& bytes) {
  bytes.add_text("$MeshFormat\n").add_text(version).add_text(" 1 8\n");
  bytes.add(std::int32_t{1}).add_text("\n$EndMeshFormat\n").add_text(kGroups);
}

// ---- 4.1: tags and counts of 64 bits, nodes and elements by entity ------------------------------

struct Msh4Layout {
  std::uint64_t num_vertices, num_cells, num_facets;
  std::uint64_t tags, coordinates, cells, facets, end;  // places in the file
};

// Numbers from 1 on, in the mesh of all ranks.
struct Msh4Tags {
  std::uint64_t first_cell = 1, first_facet = 1;
  std::uint64_t least_vertex = 0, most_vertex = 0;  // 0: there are none
};

Msh4Tags tags_of(MeshSource& mesh) {
  Msh4Tags tags;
  tags.first_cell += mesh.first_of_all_cells();
  tags.first_facet += mesh.num_all_cells();
  if (mesh.part()) tags.first_facet += mesh.boundary().num_facets_of_lower_ranks();
  if (mesh.num_vertices() == 0) return tags;
  const auto [least, most] = mesh.range_of_numbers();
  tags.least_vertex = least + 1;
  tags.most_vertex = most + 1;
  return tags;
}

// Of a part, its own: 1 are those of the whole.
std::int32_t entity_of(const std::optional<MeshPart>& part) { return part ? part->rank + 2 : 1; }

// No points, no curves, one surface, and one volume.
void add_entity_counts(Bytes& bytes) {
  for (const std::uint64_t count : {0, 0, 1, 1}) bytes.add(count);
}

void add_box_and_group(const Box& box, std::int32_t group, Bytes& bytes) {
  bytes.add(box.min.x).add(box.min.y).add(box.min.z).add(box.max.x).add(box.max.y).add(box.max.z);
  bytes.add(std::uint64_t{1}).add(group);
}

// The surface bounds the volume.
void add_entities(const Box& box, Bytes& bytes) {
  bytes.add_text("$Entities\n");
  add_entity_counts(bytes);
  bytes.add(kSurface);
  add_box_and_group(box, kBoundaryGroup, bytes);
  bytes.add(std::uint64_t{0}).add(kVolume);
  add_box_and_group(box, kVolumeGroup, bytes);
  bytes.add(std::uint64_t{1}).add(kSurface);
  bytes.add_text("\n$EndEntities\n");
}

// What a part has of them: no ghosts, and no entities between partitions.
void add_partitioned_entities(const Box& box, const MeshPart& part, Bytes& bytes) {
  const auto add_part_of = [&](std::int32_t dimension, std::int32_t entity, std::int32_t group) {
    bytes.add(entity_of(part)).add(dimension).add(entity).add(std::uint64_t{1}).add(part.rank + 1);
    add_box_and_group(box, group, bytes);
    bytes.add(std::uint64_t{0});
  };
  bytes.add_text("$PartitionedEntities\n");
  bytes.add(static_cast<std::uint64_t>(part.num_ranks)).add(std::uint64_t{0});
  add_entity_counts(bytes);
  add_part_of(2, kSurface, kBoundaryGroup);
  add_part_of(3, kVolume, kVolumeGroup);
  bytes.add_text("\n$EndPartitionedEntities\n");
}

// `num_blocks`: there is one for each entity that has some of the items.
void add_section_head(std::uint64_t num_blocks, std::uint64_t num_items, std::uint64_t least_tag,
                      std::uint64_t most_tag, Bytes& bytes) {
  bytes.add(num_blocks).add(num_items);
  bytes.add(num_items > 0 ? least_tag : 0).add(num_items > 0 ? most_tag : 0);
}

void add_block_head(std::int32_t dimension, std::int32_t entity, std::int32_t type,
                    std::uint64_t count, Bytes& bytes) {
  if (count > 0) bytes.add(dimension).add(entity).add(type).add(count);
}

// The three runs of bytes around the arrays: before the nodes, before and after the elements.
struct Msh4Frame {
  Bytes before_nodes, before_cells, before_facets;
  static constexpr std::string_view kAfter = "\n$EndElements\n";
};

Msh4Frame frame_of(const MeshSource& mesh, const Msh4Layout& n, const Msh4Tags& tags) {
  const Box& box = mesh.run().surface.box;
  const std::int32_t entity = entity_of(mesh.part());
  const std::uint64_t num_volumes = n.num_cells > 0 ? 1 : 0,
                      num_surfaces = n.num_facets > 0 ? 1 : 0;
  Msh4Frame frame;
  Bytes& head = frame.before_nodes;
  add_format("4.1", head);
  add_entities(box, head);
  if (const auto part = mesh.part()) add_partitioned_entities(box, *part, head);
  head.add_text("$Nodes\n");
  add_section_head(num_volumes, n.num_vertices, tags.least_vertex, tags.most_vertex, head);
  add_block_head(3, entity, 0, n.num_vertices, head);
  Bytes& middle = frame.before_cells;
  middle.add_text("\n$EndNodes\n$Elements\n");
  const std::uint64_t end_tag =
      num_surfaces > 0 ? tags.first_facet + n.num_facets : tags.first_cell + n.num_cells;
  add_section_head(num_volumes + num_surfaces, n.num_cells + n.num_facets, tags.first_cell,
                   end_tag - 1, middle);
  add_block_head(3, entity, kTetrahedron, n.num_cells, middle);
  add_block_head(2, entity, kTriangle, n.num_facets, frame.before_facets);
  return frame;
}

constexpr std::uint64_t kCellBytes4 = 5 * 8, kFacetBytes4 = 4 * 8;

void place_arrays(const Msh4Frame& frame, Msh4Layout& layout) {
  layout.tags = frame.before_nodes.size();
  layout.coordinates = layout.tags + 8 * layout.num_vertices;
  layout.cells = layout.coordinates + 24 * layout.num_vertices + frame.before_cells.size();
  layout.facets = layout.cells + kCellBytes4 * layout.num_cells + frame.before_facets.size();
  layout.end = layout.facets + kFacetBytes4 * layout.num_facets;
}

void write_piece4(const MeshSource& mesh, const MeshPiece& piece, const Msh4Layout& layout,
                  std::uint64_t first_tag, PlacedFile& out) {
  const auto tag_of = [&](std::uint64_t vertex) { return mesh.number_of(vertex) + 1; };
  std::vector<std::uint64_t> tags(piece.points.size());
  for (std::size_t i = 0; i < tags.size(); ++i) tags[i] = tag_of(piece.first_vertex + i);
  std::vector<std::array<std::uint64_t, 5>> cells(piece.cells.size());
  for (std::size_t i = 0; i < cells.size(); ++i) {
    cells[i][0] = first_tag + piece.first_cell + i;
    for (std::size_t k = 0; k < 4; ++k)
      cells[i][k + 1] = tag_of(static_cast<std::uint64_t>(piece.cells[i][k]));
  }
  const std::array<PlacedFile::Part, 3> parts = {
      {{layout.tags + 8 * piece.first_vertex, std::as_bytes(std::span(tags))},
       {layout.coordinates + 24 * piece.first_vertex, std::as_bytes(std::span(piece.points))},
       {layout.cells + kCellBytes4 * piece.first_cell, std::as_bytes(std::span(cells))}}};
  out.write(parts);
}

// ---- 2.2: all of 32 bits ------------------------------------------------------------------------

struct Node2 {
  std::int32_t tag;
  std::array<double, 3> position;
} __attribute__((packed));

template <std::size_t num_vertices>
using Element2 = std::array<std::int32_t, 3 + num_vertices>;  // tag, group, entity, vertices

template <std::size_t num_vertices>
Element2<num_vertices> element2(std::uint64_t tag, std::int32_t group, std::int32_t entity,
                                const auto& vertices) {
  Element2<num_vertices> element = {static_cast<std::int32_t>(tag), group, entity};
  for (std::size_t k = 0; k < num_vertices; ++k)
    element[3 + k] = static_cast<std::int32_t>(vertices[k]) + 1;
  return element;
}

// Of `count` elements, each with two tags.
void add_element_head2(std::int32_t type, std::uint64_t count, Bytes& bytes) {
  if (count > 0) bytes.add(type).add(static_cast<std::int32_t>(count)).add(std::int32_t{2});
}

}  // namespace

std::uint64_t write_msh4(MeshSource& mesh, PartialFile& file) {
  BoundarySurface& boundary = mesh.boundary();
  Msh4Layout layout{
      mesh.num_vertices(), mesh.num_cells(), mesh.num_boundary_facets(), 0, 0, 0, 0, 0};
  const Msh4Tags tags = tags_of(mesh);
  const Msh4Frame frame = frame_of(mesh, layout, tags);
  place_arrays(frame, layout);
  const std::uint64_t bytes = layout.end + Msh4Frame::kAfter.size();
  PlacedFile out(file);
  do_on_all(mesh.exchange(), [&] {
    if (mesh.is_of_first_rank()) {
      file.reserve(bytes);
      file.write_at(0, frame.before_nodes.bytes());
      file.write_at(layout.cells - frame.before_cells.size(), frame.before_cells.bytes());
      file.write_at(layout.facets - frame.before_facets.size(), frame.before_facets.bytes());
    }
    mesh.for_each_piece(
        {.has_points = true, .has_cells = true},
        [&](const MeshPiece& piece) {
          write_piece4(mesh, piece, layout, tags.first_cell, out);
          return true;
        },
        [](bool) {});
  });
  const auto facet_lines = [&](const BoundarySurface::Facets& some) {
    Bytes list;
    std::uint64_t tag = 1 + mesh.num_all_cells() + some.first;
    for (const auto& [a, b, c] : std::views::transform(some.facets, &BoundaryFacet::vertices))
      list.add(std::array<std::uint64_t, 4>{tag++, a + 1, b + 1, c + 1});
    return list;
  };
  AppendedFile facets(file, mesh.exchange(), layout.facets);
  append_boundary(facets, mesh, boundary.facets({}), facet_lines,
                  kFacetBytes4 * boundary.num_own_facets());
  facets.append(Msh4Frame::kAfter);
  return bytes;
}

std::uint64_t write_msh2(MeshSource& mesh, PartialFile& file) {
  BoundarySurface& boundary = mesh.boundary();
  const std::uint64_t num_cells = mesh.num_cells(), num_facets = boundary.num_facets();
  AppendedFile out(file, mesh.exchange());
  Bytes head;
  add_format("2.2", head);
  out.append(head.bytes());
  out.append(Text().add("$Nodes\n").add(mesh.num_vertices()).add('\n').text());
  const auto node_lines = [](const MeshPiece& piece) {
    Bytes nodes;
    nodes.reserve(sizeof(Node2) * piece.points.size());
    std::uint64_t tag = piece.first_vertex;
    for (const auto& point : piece.points)
      nodes.add(Node2{static_cast<std::int32_t>(++tag), point});
    return nodes;
  };
  append_pieces(out, mesh, {.has_points = true}, node_lines,
                sizeof(Node2) * mesh.own_vertices().size());
  out.append(Text().add("\n$EndNodes\n$Elements\n").add(num_cells + num_facets).add('\n').text());
  Bytes cell_head, facet_head;
  add_element_head2(kTetrahedron, num_cells, cell_head);
  out.append(cell_head.bytes());
  const auto cell_lines = [](const MeshPiece& piece) {
    Bytes cells;
    cells.reserve(sizeof(Element2<4>) * piece.cells.size());
    std::uint64_t tag = piece.first_cell;
    for (const auto& cell : piece.cells) cells.add(element2<4>(++tag, kVolumeGroup, kVolume, cell));
    return cells;
  };
  append_pieces(out, mesh, {.has_cells = true}, cell_lines,
                sizeof(Element2<4>) * mesh.own_cells().size());
  add_element_head2(kTriangle, num_facets, facet_head);
  out.append(facet_head.bytes());
  const auto facet_lines = [&](const BoundarySurface::Facets& some) {
    Bytes list;
    std::uint64_t tag = num_cells + some.first;
    for (const BoundaryFacet& facet : some.facets)
      list.add(element2<3>(++tag, kBoundaryGroup, kSurface, facet.vertices));
    return list;
  };
  append_boundary(out, mesh, boundary.facets({}), facet_lines,
                  sizeof(Element2<3>) * boundary.num_own_facets());
  out.append("\n$EndElements\n");
  return out.size();
}

}  // namespace locvol
