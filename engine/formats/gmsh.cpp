#include <algorithm>
#include <array>
#include <bit>
#include <map>
#include <optional>
#include <span>
#include <vector>

#include "engine/formats/formats.h"
#include "engine/formats/outputs.h"
#include "engine/formats/sheet_names.h"

namespace locvol {
namespace {

static_assert(std::endian::native == std::endian::little, "written as the machine has it");

// Gmsh's types of elements. Of second order, the last two nodes of a tetrahedron change places.
constexpr std::int32_t kPoint = 15;
constexpr std::int32_t line_type(int order) { return order == 2 ? 8 : 1; }
constexpr std::int32_t triangle_type(int order) { return order == 2 ? 9 : 2; }
constexpr std::int32_t tetrahedron_type(int order) { return order == 2 ? 11 : 4; }
constexpr std::array<std::size_t, 6> kGmshCellNodes = {0, 1, 2, 3, 5, 4};

// Entities have the ids of what they are: bodies are volumes, sheets surfaces, creases curves and
// corners points.
std::int32_t volume_of(BodyId body) { return static_cast<std::int32_t>(body); }
std::int32_t surface_of(SheetId sheet) { return static_cast<std::int32_t>(sheet); }

// Numbers of physical groups, which are all different: sheets have their ids, then come the bodies,
// and then those creases and corners that the mesh has.
class Groups {
 public:
  explicit Groups(MeshSource& mesh) : mesh_(mesh), num_sheets_(mesh.boundary().num_sheets()) {}
  std::int32_t of_body(BodyId body) const { return static_cast<std::int32_t>(num_sheets_ + body); }
  std::int32_t of_crease(std::uint64_t crease) const {
    return last_of_bodies() + static_cast<std::int32_t>(crease);
  }
  std::int32_t of_corner(std::uint64_t corner) const {
    return last_of_bodies() + static_cast<std::int32_t>(mesh_.sheets().creases.size() + corner);
  }

  void add_names(Bytes& bytes) const {
    const MeshNames names =
        names_of_mesh(mesh_.sheets(), mesh_.has_creases(),
                      {.most_bytes = 127, .forbidden = "\"\\", .taken = {"volume"}});
    std::uint64_t num = 0;
    Text lines;
    const auto add = [&](std::string_view dimension, std::int32_t group, std::string_view name) {
      lines.add(dimension).add(' ').add(static_cast<std::uint64_t>(group));
      lines.add(" \"").add(name).add("\"\n");
      ++num;
    };
    for (SheetId sheet = 1; sheet <= num_sheets_; ++sheet)
      add("2", surface_of(sheet), names.sheets[sheet - 1]);
    for (BodyId body = 1; body <= mesh_.num_bodies(); ++body)
      add("3", of_body(body), names.bodies[body - 1]);
    if (mesh_.has_creases()) {
      const auto kept = mesh_.creases().kept();
      for (std::size_t c = 0; c < kept.size(); ++c)
        if (kept[c].num_edges > 0) add("1", of_crease(c + 1), names.creases[c]);
      for (const KeptCorner& corner : mesh_.creases().corners())
        add("0", of_corner(corner.corner), names.corners.at(corner.corner - 1));
    }
    Text head;
    head.add("$PhysicalNames\n").add(num).add('\n');
    bytes.add_text(head.text()).add_text(lines.text()).add_text("$EndPhysicalNames\n");
  }

 private:
  std::int32_t last_of_bodies() const { return of_body(static_cast<BodyId>(mesh_.num_bodies())); }

  MeshSource& mesh_;
  SheetId num_sheets_;
};

// "4.1 1 8": binary, and the size of a double; 1 as an integer tells the order of bytes.
void add_format(std::string_view version, const Groups& groups, Bytes& bytes) {
  bytes.add_text("$MeshFormat\n").add_text(version).add_text(" 1 8\n");
  bytes.add(std::int32_t{1}).add_text("\n$EndMeshFormat\n");
  groups.add_names(bytes);
}

// ---- 4.1: tags and counts of 64 bits, nodes and elements by entity ------------------------------

struct Msh4Layout {
  std::uint64_t num_vertices, num_cells, num_facets, num_edges, num_corners;
  std::uint64_t tags = 0, coordinates = 0, facets = 0, end = 0;  // places in the file
  std::vector<std::uint64_t> cells = {};                         // likewise, by body
};

// Numbers from 1 on, in the mesh of all ranks.
struct Msh4Tags {
  std::uint64_t first_cell = 1;
  std::uint64_t least_vertex = 0, most_vertex = 0;  // 0: there are none
};

Msh4Tags tags_of(MeshSource& mesh) {
  Msh4Tags tags;
  tags.first_cell += mesh.first_of_all_cells();
  if (mesh.num_vertices() == 0) return tags;
  const auto [least, most] = mesh.range_of_numbers();
  tags.least_vertex = least + 1;
  tags.most_vertex = most + 1;
  return tags;
}

// Of a part, its own, after those of the whole: one of so many volumes, surfaces, curves or points.
std::int32_t entity_of(std::uint64_t id, std::uint64_t num_all,
                       const std::optional<MeshPart>& part) {
  const auto whole = static_cast<std::int32_t>(id);
  return part ? (part->rank + 1) * static_cast<std::int32_t>(num_all) + whole : whole;
}

// Of creases and corners those that the mesh has, by id.
struct CreaseEntities {
  std::vector<CreaseId> curves;
  std::span<const KeptCorner> points;
  bool has_curve(CreaseId crease) const { return std::ranges::binary_search(curves, crease); }
  bool has_point(std::uint64_t corner) const {
    return std::ranges::binary_search(points, corner, {}, &KeptCorner::corner);
  }
};

CreaseEntities crease_entities(MeshSource& mesh) {
  CreaseEntities entities;
  if (!mesh.has_creases()) return entities;
  const auto kept = mesh.creases().kept();
  for (CreaseId crease = 1; crease <= kept.size(); ++crease)
    if (kept[crease - 1].num_edges > 0) entities.curves.push_back(crease);
  entities.points = mesh.creases().corners();
  return entities;
}

// Points, curves, surfaces and volumes.
void add_entity_counts(const CreaseEntities& creases, SheetId num_sheets, std::size_t num_bodies,
                       Bytes& bytes) {
  for (const std::uint64_t count :
       {creases.points.size(), creases.curves.size(), std::size_t{num_sheets}, num_bodies})
    bytes.add(count);
}

void add_place_and_group(const Point& place, std::int32_t group, Bytes& bytes) {
  bytes.add(place.x).add(place.y).add(place.z).add(std::uint64_t{1}).add(group);
}

void add_bounds(const std::vector<std::int32_t>& entities, Bytes& bytes) {
  bytes.add(std::uint64_t{entities.size()});
  for (const std::int32_t entity : entities) bytes.add(entity);
}

// Points that bound a curve, curves that bound a surface.
std::vector<std::int32_t> ends_of(const CreaseFacts& crease, const CreaseEntities& entities) {
  std::vector<std::int32_t> ends;
  for (const std::uint32_t corner : crease.corners)
    if (entities.has_point(corner)) ends.push_back(static_cast<std::int32_t>(corner));
  return ends;
}
std::vector<std::int32_t> curves_around(SheetId sheet, const MeshSource& mesh,
                                        const CreaseEntities& entities) {
  std::vector<std::int32_t> curves;
  for (const CreaseId crease : entities.curves) {
    const auto& [a, b] = mesh.sheets().creases[crease - 1].sheets;
    if (a != b && (a == sheet || b == sheet)) curves.push_back(static_cast<std::int32_t>(crease));
  }
  return curves;
}

void add_box_and_group(const Box& box, std::int32_t group, Bytes& bytes) {
  bytes.add(box.min.x).add(box.min.y).add(box.min.z).add(box.max.x).add(box.max.y).add(box.max.z);
  bytes.add(std::uint64_t{1}).add(group);
}

Box box_of(const MeshSource& mesh, SheetId sheet) {
  const auto& sheets = mesh.sheets().sheets;
  return sheets.empty() ? mesh.run().surface.box : sheets[sheet - 1].box;
}

// Of the sheets that bound a body.
std::vector<std::int32_t> surfaces_around(BodyId body, SheetId num_sheets, const MeshSource& mesh) {
  std::vector<std::int32_t> surfaces;
  const auto& sheets = mesh.sheets().sheets;
  for (SheetId sheet = 1; sheet <= num_sheets; ++sheet)
    if (!mesh.has_bodies() || sheets.empty() ||
        std::ranges::count(sheets[sheet - 1].bodies, body) > 0)
      surfaces.push_back(surface_of(sheet));
  return surfaces;
}

// Corners bound creases, these sheets, and these the bodies.
void add_entities(MeshSource& mesh, SheetId num_sheets, const Groups& groups, Bytes& bytes) {
  const CreaseEntities creases = crease_entities(mesh);
  bytes.add_text("$Entities\n");
  add_entity_counts(creases, num_sheets, mesh.num_bodies(), bytes);
  for (const KeptCorner& corner : creases.points) {
    bytes.add(static_cast<std::int32_t>(corner.corner));
    add_place_and_group(corner.position, groups.of_corner(corner.corner), bytes);
  }
  for (const CreaseId crease : creases.curves) {
    bytes.add(static_cast<std::int32_t>(crease));
    add_box_and_group(mesh.creases().kept()[crease - 1].box, groups.of_crease(crease), bytes);
    add_bounds(ends_of(mesh.sheets().creases[crease - 1], creases), bytes);
  }
  for (SheetId sheet = 1; sheet <= num_sheets; ++sheet) {
    bytes.add(surface_of(sheet));
    add_box_and_group(box_of(mesh, sheet), surface_of(sheet), bytes);
    add_bounds(curves_around(sheet, mesh, creases), bytes);
  }
  for (BodyId body = 1; body <= mesh.num_bodies(); ++body) {
    bytes.add(volume_of(body));
    add_box_and_group(mesh.run().surface.box, groups.of_body(body), bytes);
    add_bounds(surfaces_around(body, num_sheets, mesh), bytes);
  }
  bytes.add_text("\n$EndEntities\n");
}

// What a part has of them: no ghosts, and no entities between partitions.
void add_partitioned_entities(MeshSource& mesh, SheetId num_sheets, const Groups& groups,
                              const MeshPart& part, Bytes& bytes) {
  const auto add_part_of = [&](std::int32_t dimension, std::int32_t entity, std::int32_t whole) {
    bytes.add(entity).add(dimension).add(whole).add(std::uint64_t{1}).add(part.rank + 1);
  };
  const auto add_rest = [&](const Box& box, std::int32_t group) {
    add_box_and_group(box, group, bytes);
    bytes.add(std::uint64_t{0});
  };
  const CreaseEntities creases = crease_entities(mesh);
  bytes.add_text("$PartitionedEntities\n");
  bytes.add(static_cast<std::uint64_t>(part.num_ranks)).add(std::uint64_t{0});
  add_entity_counts(creases, num_sheets, mesh.num_bodies(), bytes);
  for (const KeptCorner& corner : creases.points) {
    add_part_of(0, entity_of(corner.corner, mesh.sheets().num_corners, part),
                static_cast<std::int32_t>(corner.corner));
    add_place_and_group(corner.position, groups.of_corner(corner.corner), bytes);
  }
  for (const CreaseId crease : creases.curves) {
    add_part_of(1, entity_of(crease, mesh.sheets().creases.size(), part),
                static_cast<std::int32_t>(crease));
    add_rest(mesh.creases().kept()[crease - 1].box, groups.of_crease(crease));
  }
  for (SheetId sheet = 1; sheet <= num_sheets; ++sheet) {
    add_part_of(2, entity_of(sheet, num_sheets, part), surface_of(sheet));
    add_rest(box_of(mesh, sheet), surface_of(sheet));
  }
  for (BodyId body = 1; body <= mesh.num_bodies(); ++body) {
    add_part_of(3, entity_of(body, mesh.num_bodies(), part), volume_of(body));
    add_rest(mesh.run().surface.box, groups.of_body(body));
  }
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

// Of the triangles of a sheet; none if there are none.
Bytes sheet_head(MeshSource& mesh, SheetId sheet, SheetId num_sheets) {
  Bytes head;
  add_block_head(2, entity_of(sheet, num_sheets, mesh.part()), triangle_type(mesh.order()),
                 mesh.num_boundary_facets_of(sheet), head);
  return head;
}

// Likewise of the lines of a crease. REQUIRES: it is one of the mesh's; they are sorted
Bytes crease_head(MeshSource& mesh, CreaseId crease) {
  Bytes head;
  const std::uint64_t num_edges = mesh.part() ? mesh.creases().num_own_edges_of(crease)
                                              : mesh.creases().kept()[crease - 1].num_edges;
  add_block_head(1, entity_of(crease, mesh.sheets().creases.size(), mesh.part()),
                 line_type(mesh.order()), num_edges, head);
  return head;
}

// Each corner's point, with its head. Tags go by the corners of all.
Bytes corner_points(MeshSource& mesh) {
  Bytes points;
  if (!mesh.has_creases()) return points;
  std::uint64_t tag =
      mesh.num_all_cells() + mesh.boundary().num_facets() + mesh.creases().num_edges();
  for (const KeptCorner& corner : mesh.creases().corners()) {
    ++tag;
    if (!mesh.has_cell(corner.cell)) continue;
    add_block_head(0, entity_of(corner.corner, mesh.sheets().num_corners, mesh.part()), kPoint, 1,
                   points);
    points.add(tag).add(corner.vertex + 1);
  }
  return points;
}

// Of the cells of a body; none if there are none.
Bytes body_head(MeshSource& mesh, BodyId body) {
  Bytes head;
  add_block_head(3, entity_of(body, mesh.num_bodies(), mesh.part()), tetrahedron_type(mesh.order()),
                 mesh.has_bodies() ? mesh.body_cells().num_of(body) : mesh.num_cells(), head);
  return head;
}

// The bytes before the nodes, and before the elements, of which those of body_head() come before
// each body's. Before the triangles of each sheet come
// those of sheet_head(), and before the lines of each crease those of crease_head(); then
// corner_points(), and after all, kAfter.
struct Msh4Frame {
  Bytes before_nodes, before_cells;
  static constexpr std::string_view kAfter = "\n$EndElements\n";
};

Msh4Frame frame_of(MeshSource& mesh, const Msh4Layout& n, const Msh4Tags& tags) {
  BoundarySurface& boundary = mesh.boundary();
  const SheetId num_sheets = boundary.num_sheets();
  std::uint64_t num_volumes = 0;
  for (BodyId body = 1; body <= mesh.num_bodies(); ++body)
    num_volumes += body_head(mesh, body).size() > 0;
  std::uint64_t num_surfaces = 0, last_tag = tags.first_cell + n.num_cells - 1;
  for (SheetId sheet = 1; sheet <= num_sheets; ++sheet) {
    const std::uint64_t num_facets = mesh.num_boundary_facets_of(sheet);
    if (num_facets == 0) continue;
    ++num_surfaces;
    const std::uint64_t first = mesh.part() ? boundary.first_own_facet_of(sheet)
                                            : n.num_facets - num_facets;  // of the last one
    last_tag = mesh.num_all_cells() + first + num_facets;
  }
  std::uint64_t num_curves = 0;
  for (const CreaseId crease : crease_entities(mesh).curves) {
    const std::uint64_t num_edges = mesh.creases().num_own_edges_of(crease);
    if (mesh.part() && num_edges == 0) continue;
    ++num_curves;
    last_tag = mesh.num_all_cells() + boundary.num_facets() +
               (mesh.part() ? mesh.creases().first_own_edge_of(crease) + num_edges : n.num_edges);
  }
  const std::vector<KeptCorner> corners = mesh.corners();
  if (!corners.empty()) {
    const auto all = mesh.creases().corners();
    const auto last = std::ranges::lower_bound(all, corners.back().corner, {}, &KeptCorner::corner);
    last_tag = mesh.num_all_cells() + boundary.num_facets() + mesh.creases().num_edges() +
               static_cast<std::uint64_t>(last - all.begin()) + 1;
  }
  const Groups groups(mesh);
  Msh4Frame frame;
  Bytes& head = frame.before_nodes;
  add_format("4.1", groups, head);
  add_entities(mesh, num_sheets, groups, head);
  if (const auto part = mesh.part())
    add_partitioned_entities(mesh, num_sheets, groups, *part, head);
  head.add_text("$Nodes\n");
  // All nodes are said to be of the first volume.
  add_section_head(n.num_cells > 0 ? 1 : 0, n.num_vertices, tags.least_vertex, tags.most_vertex,
                   head);
  add_block_head(3, entity_of(1, mesh.num_bodies(), mesh.part()), 0, n.num_vertices, head);
  Bytes& middle = frame.before_cells;
  middle.add_text("\n$EndNodes\n$Elements\n");
  add_section_head(num_volumes + num_surfaces + num_curves + n.num_corners,
                   n.num_cells + n.num_facets + n.num_edges + n.num_corners, tags.first_cell,
                   last_tag, middle);
  return frame;
}

constexpr std::uint64_t cell_bytes4(int order) { return 8 * (1 + num_corners_of_cell(order)); }
constexpr std::uint64_t facet_bytes4(int order) { return 8 * (1 + num_corners_of_facet(order)); }
constexpr std::uint64_t edge_bytes4(int order) { return 8 * (1 + num_corners_of_edge(order)); }

void place_arrays(MeshSource& mesh, const Msh4Frame& frame, Msh4Layout& layout) {
  layout.tags = frame.before_nodes.size();
  layout.coordinates = layout.tags + 8 * layout.num_vertices;
  layout.facets = layout.coordinates + 24 * layout.num_vertices + frame.before_cells.size();
  for (BodyId body = 1; body <= mesh.num_bodies(); ++body) {
    layout.facets += body_head(mesh, body).size();
    layout.cells.push_back(layout.facets);
    layout.facets += cell_bytes4(mesh.order()) *
                     (mesh.has_bodies() ? mesh.body_cells().num_of(body) : layout.num_cells);
  }
  layout.end = layout.facets + facet_bytes4(mesh.order()) * layout.num_facets;
  const SheetId num_sheets = mesh.boundary().num_sheets();
  for (SheetId sheet = 1; sheet <= num_sheets; ++sheet)
    layout.end += sheet_head(mesh, sheet, num_sheets).size();
  for (const CreaseId crease : crease_entities(mesh).curves)
    layout.end += crease_head(mesh, crease).size();
  layout.end += edge_bytes4(mesh.order()) * layout.num_edges + corner_points(mesh).size();
}

// Those of one body in one leaf, or all of a mesh of one body.
struct PlacedCells {
  std::uint64_t place = 0;  // in the file
  std::vector<std::uint64_t> words = {};
};

// `body_cells`: null where there is one body
void write_piece4(const MeshSource& mesh, const BodyCells* body_cells, const MeshPiece& piece,
                  const Msh4Layout& layout, std::uint64_t first_tag, PlacedFile& out) {
  const auto tag_of = [&](auto point) {
    return mesh.number_of(static_cast<std::uint64_t>(point)) + 1;
  };
  std::vector<std::uint64_t> tags(piece.points.size());
  for (std::size_t i = 0; i < tags.size(); ++i) tags[i] = tag_of(piece.first_vertex + i);
  std::vector<std::uint64_t> node_tags(piece.node_points.size());
  for (std::size_t i = 0; i < node_tags.size(); ++i) node_tags[i] = tag_of(piece.first_node + i);
  const auto add_cell = [&](std::size_t i, std::vector<std::uint64_t>& cells) {
    cells.push_back(first_tag + piece.first_cell + i);
    for (const std::int64_t v : piece.cells[i]) cells.push_back(tag_of(v));
    if (!piece.nodes.empty())
      for (const std::size_t n : kGmshCellNodes) cells.push_back(tag_of(piece.nodes[i][n]));
  };
  const std::uint64_t cell_bytes = cell_bytes4(mesh.order());
  std::vector<PlacedCells> cells;
  if (body_cells == nullptr) {
    cells.push_back({layout.cells.front() + cell_bytes * piece.first_cell});
    cells.front().words.reserve(cell_bytes / 8 * piece.cells.size());
    for (std::size_t i = 0; i < piece.cells.size(); ++i) add_cell(i, cells.front().words);
  } else {
    std::size_t i = 0;
    for (const LeafRun& run : piece.runs) {
      std::map<BodyId, std::vector<std::uint64_t>> of_bodies;
      for (const std::size_t end = i + run.num_listed + run.num_core; i < end; ++i)
        add_cell(i, of_bodies[piece.bodies[i]]);
      const std::size_t leaf = run.leaf - mesh.first_place();
      for (auto& [body, words] : of_bodies)
        cells.push_back({layout.cells[body - 1] + cell_bytes * body_cells->place(leaf, body),
                         std::move(words)});
    }
  }
  std::vector<PlacedFile::Part> parts = {
      {layout.tags + 8 * piece.first_vertex, std::as_bytes(std::span(tags))},
      {layout.coordinates + 24 * piece.first_vertex, std::as_bytes(std::span(piece.points))},
      {layout.tags + 8 * piece.first_node, std::as_bytes(std::span(node_tags))},
      {layout.coordinates + 24 * piece.first_node, std::as_bytes(std::span(piece.node_points))}};
  for (const auto& [place, words] : cells)
    parts.push_back({place, std::as_bytes(std::span(words))});
  out.write(parts);
}

// ---- 2.2: all of 32 bits ------------------------------------------------------------------------

struct Node2 {
  std::int32_t tag;
  std::array<double, 3> position;
} __attribute__((packed));

// Tag, group, entity, vertices.
constexpr std::uint64_t element_bytes2(std::uint64_t num_corners) { return 4 * (3 + num_corners); }
void add_element2(std::uint64_t tag, std::int32_t group, std::int32_t entity, const auto& vertices,
                  Bytes& bytes) {
  bytes.add(static_cast<std::int32_t>(tag)).add(group).add(entity);
  for (const auto v : vertices) bytes.add(static_cast<std::int32_t>(v) + 1);
}

// Of `count` elements, each with two tags.
void add_element_head2(std::int32_t type, std::uint64_t count, Bytes& bytes) {
  if (count > 0) bytes.add(type).add(static_cast<std::int32_t>(count)).add(std::int32_t{2});
}

}  // namespace

std::uint64_t write_msh4(MeshSource& mesh, PartialFile& file) {
  BoundarySurface& boundary = mesh.boundary();
  boundary.sort_facets();
  if (mesh.has_creases()) mesh.creases().sort();
  Msh4Layout layout{.num_vertices = mesh.num_points(),
                    .num_cells = mesh.num_cells(),
                    .num_facets = mesh.num_boundary_facets(),
                    .num_edges = mesh.num_crease_edges(),
                    .num_corners = mesh.corners().size()};
  const Msh4Tags tags = tags_of(mesh);
  const Msh4Frame frame = frame_of(mesh, layout, tags);
  place_arrays(mesh, frame, layout);
  const BodyCells* body_cells = mesh.has_bodies() ? &mesh.body_cells() : nullptr;
  const std::uint64_t bytes = layout.end + Msh4Frame::kAfter.size();
  PlacedFile out(file);
  do_on_all(mesh.exchange(), [&] {
    if (mesh.is_of_first_rank()) {
      file.reserve(bytes);
      file.write_at(0, frame.before_nodes.bytes());
      file.write_at(layout.coordinates + 24 * layout.num_vertices, frame.before_cells.bytes());
      for (BodyId body = 1; body <= mesh.num_bodies(); ++body) {
        const Bytes head = body_head(mesh, body);
        file.write_at(layout.cells[body - 1] - head.size(), head.bytes());
      }
    }
    mesh.for_each_piece(
        {.has_points = true, .has_cells = true, .has_node_points = true},
        [&](const MeshPiece& piece) {
          write_piece4(mesh, body_cells, piece, layout, tags.first_cell, out);
          return true;
        },
        [](bool) {});
  });
  const auto facet_lines = [&](const BoundarySurface::Facets& some) {
    Bytes list;
    for (std::size_t i = 0; i < some.facets.size(); ++i) {
      list.add(1 + mesh.num_all_cells() + some.first + i);
      for (const std::uint64_t v : some.facets[i].vertices) list.add(v + 1);
      if (some.nodes.empty()) continue;
      for (const std::uint64_t n : some.nodes[i]) list.add(n + 1);
    }
    return list;
  };
  AppendedFile facets(file, mesh.exchange(), layout.facets);
  for (SheetId sheet = 1; sheet <= boundary.num_sheets(); ++sheet) {
    facets.append(sheet_head(mesh, sheet, boundary.num_sheets()).bytes());
    append_boundary(facets, mesh, boundary.facets_of(sheet, {}), facet_lines,
                    facet_bytes4(mesh.order()) * boundary.num_own_facets_of(sheet));
  }
  const auto edge_lines = [&](const KeptCreases::Edges& some) {
    Bytes list;
    for (std::size_t i = 0; i < some.edges.size(); ++i) {
      list.add(1 + mesh.num_all_cells() + boundary.num_facets() + some.first + i);
      for (const std::uint64_t v : some.edges[i].vertices) list.add(v + 1);
      if (!some.nodes.empty()) list.add(some.nodes[i] + 1);
    }
    return list;
  };
  for (const CreaseId crease : crease_entities(mesh).curves) {
    facets.append(crease_head(mesh, crease).bytes());
    append_boundary(facets, mesh, mesh.creases().edges_of(crease), edge_lines,
                    edge_bytes4(mesh.order()) * mesh.creases().num_own_edges_of(crease));
  }
  facets.append(corner_points(mesh).bytes());
  facets.append(Msh4Frame::kAfter);
  return bytes;
}

std::uint64_t write_msh2(MeshSource& mesh, PartialFile& file) {
  BoundarySurface& boundary = mesh.boundary();
  const std::uint64_t num_cells = mesh.num_cells(), num_facets = boundary.num_facets(),
                      num_edges = mesh.num_crease_edges();
  const std::vector<KeptCorner> corners = mesh.corners();
  const Groups groups(mesh);
  const int order = mesh.order();
  const std::uint64_t cell_bytes = element_bytes2(num_corners_of_cell(order)),
                      facet_bytes = element_bytes2(num_corners_of_facet(order)),
                      edge_bytes = element_bytes2(num_corners_of_edge(order));
  AppendedFile out(file, mesh.exchange());
  Bytes head;
  add_format("2.2", groups, head);
  out.append(head.bytes());
  out.append(Text().add("$Nodes\n").add(mesh.num_points()).add('\n').text());
  const auto node_lines = [](const std::vector<MeshPiece::Vertex>& points, std::uint64_t tag) {
    Bytes nodes;
    nodes.reserve(sizeof(Node2) * points.size());
    for (const auto& point : points) nodes.add(Node2{static_cast<std::int32_t>(++tag), point});
    return nodes;
  };
  append_pieces(
      out, mesh, {.has_points = true},
      [&](const MeshPiece& piece) { return node_lines(piece.points, piece.first_vertex); },
      sizeof(Node2) * mesh.own_vertices().size());
  if (order == 2)
    append_pieces(
        out, mesh, {.has_node_points = true},
        [&](const MeshPiece& piece) { return node_lines(piece.node_points, piece.first_node); },
        sizeof(Node2) * mesh.own_nodes().size());
  out.append(Text()
                 .add("\n$EndNodes\n$Elements\n")
                 .add(num_cells + num_facets + num_edges + corners.size())
                 .add('\n')
                 .text());
  Bytes cell_head, facet_head, edge_head, points;
  add_element_head2(tetrahedron_type(order), num_cells, cell_head);
  out.append(cell_head.bytes());
  const auto cell_lines = [&](const MeshPiece& piece) {
    Bytes cells;
    cells.reserve(cell_bytes * piece.cells.size());
    for (std::size_t i = 0; i < piece.cells.size(); ++i) {
      const BodyId body = piece.body_of(i);
      add_element2(piece.first_cell + i + 1, groups.of_body(body), volume_of(body), piece.cells[i],
                   cells);
      if (piece.nodes.empty()) continue;
      for (const std::size_t n : kGmshCellNodes)
        cells.add(static_cast<std::int32_t>(piece.nodes[i][n]) + 1);
    }
    return cells;
  };
  append_pieces(out, mesh, {.has_cells = true}, cell_lines, cell_bytes * mesh.own_cells().size());
  add_element_head2(triangle_type(order), num_facets, facet_head);
  out.append(facet_head.bytes());
  const auto facet_lines = [&](const BoundarySurface::Facets& some) {
    Bytes list;
    for (std::size_t i = 0; i < some.facets.size(); ++i) {
      const std::int32_t surface = surface_of(some.facets[i].labels.sheet);
      add_element2(num_cells + some.first + i + 1, surface, surface, some.facets[i].vertices, list);
      if (some.nodes.empty()) continue;
      for (const std::uint64_t n : some.nodes[i]) list.add(static_cast<std::int32_t>(n) + 1);
    }
    return list;
  };
  append_boundary(out, mesh, boundary.facets({}), facet_lines,
                  facet_bytes * boundary.num_own_facets());
  add_element_head2(line_type(order), num_edges, edge_head);
  out.append(edge_head.bytes());
  const auto edge_lines = [&](const LinePiece& piece) {
    Bytes list;
    std::uint64_t tag = num_cells + num_facets + piece.first;
    for (std::size_t i = 0; i < piece.lines.size(); ++i) {
      const CreaseId crease = piece.creases[i];
      add_element2(++tag, groups.of_crease(crease), static_cast<std::int32_t>(crease),
                   piece.lines[i], list);
      if (piece.nodes.empty()) continue;
      for (const std::int64_t n : piece.nodes[i]) list.add(static_cast<std::int32_t>(n) + 1);
    }
    return list;
  };
  append_boundary(out, mesh, mesh.lines(), edge_lines, edge_bytes * mesh.own_lines().size());
  add_element_head2(kPoint, corners.size(), points);
  std::uint64_t tag = num_cells + num_facets + num_edges;
  for (const KeptCorner& corner : corners)
    add_element2(++tag, groups.of_corner(corner.corner), static_cast<std::int32_t>(corner.corner),
                 std::array{corner.vertex}, points);
  out.append(points.bytes());
  out.append("\n$EndElements\n");
  return out.size();
}

}  // namespace locvol
