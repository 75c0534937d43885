#include "storage/codec.h"

#include <zstd.h>

#include <algorithm>
#include <array>
#include <bit>
#include <boost/archive/detail/common_iarchive.hpp>
#include <boost/archive/detail/common_oarchive.hpp>
#include <boost/mp11/algorithm.hpp>
#include <boost/mp11/list.hpp>
#include <boost/serialization/array_wrapper.hpp>
#include <boost/serialization/item_version_type.hpp>
#include <boost/serialization/level.hpp>
#include <boost/serialization/split_free.hpp>
#include <boost/serialization/string.hpp>
#include <boost/serialization/vector.hpp>
#include <boost/serialization/version.hpp>
#include <boost/serialization/wrapper.hpp>
#include <cassert>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <mutex>
#include <new>
#include <optional>
#include <tuple>
#include <type_traits>
#include <unordered_map>
#include <utility>
#include <vector>

#include "octree/table_hash.h"

// The bytes of a record
// =====================
// A record is one zstd frame (RFC 8878) with content size and content checksum (XXH64). In it, an
// archive of Boost.Serialization, in which the record comes with its class version:
//
//   | kind u8 | leaf u64 | version u32 | fields ... |
//
// Fields are those that serialize() names, in its order. Numbers are little-endian and unpadded,
// bool and enumerations u8, double 8 bytes, text its length u64 and its characters. A long list is
// columns, each of one value of every item, lowest bytes first (byte-shuffled), for neighbors
// differ in their low bytes only and zstd finds the runs in the high ones:
//
//   list:   | number of items u64 | column | column | ... |
//   column: | byte 0 of every value | byte 1 of every value | ... |
//
// Kinds, with lists in brackets ("steps" are differences to the value before, "changed bits" the
// exclusive or with it, both from 0):
//
// clang-format off
//   0 format      version u32
//   1 run         parameters, surface facts (notes: their number u64, texts), frame, progress; weld:
//                 present u8 and, if so, a number; sharp angle; [size changed bits u64, of sheets]
//                 and the name of each; has creases u8; bodies are asked for u8, names of voids and
//                 of more files, each list as notes; sizes of bodies as of sheets; gap
//   2 leaf        the fields of LeafInfo; `queued` as present u8 and, if so, epoch u32, color u32;
//                 the center's body as inside u8, and at last its number u32
//   3 points      [id steps u64 | x | y | z changed bits u64 | kind u8], and the core: whole u8,
//                 [steps u32 of a row's first i | j | k | number of sites u32]; has other bodies
//                 than the only one u8 and, if so, [body u32, of each row], body u32
//   4 cells       [vertex steps u64]
//                 [first corner's steps u32 | second - first u32 | third - first | fourth - first]
//                 [x | y | z changed bits u64, of what `asked` has] [body u32]
//   5 surface     [id steps u64] [x | y | z changed bits u64, of each distinct corner, in order of
//                 appearance] [references u32, three to a triangle: distinct corners so far -
//                 index; 0 is the next new one] [sheet u32]; creases or corners: present u8 and, if
//                 so, [x | y | z changed bits u64, of each end | is a corner u8, of each | sheet
//                 u32, of each side | crease u32] [x | y | z changed bits u64 | id u32]; has
//                 other bodies than the only one u8 and, if so, [change of the state u32, a code]
//   6 unresolved  [condition u8 | x | y | z | radius changed bits u64]
//   7 queue       position, leaf
//   8 memory      the fields of MemoryRecord
//   9 keys        [sum u64]
//  10 timeline    [the numbers of a TimelineSample, steps u64 | phase u8]
//  11 sizes       [key steps u64 | distance f32, of each corner | excess f32 | less f32, of each corner] [node steps u64 | size f32]
//  12 rank        first [key steps u64], rank u32, superstep u64; `applied` as `queued`; is all
//                 sent u8, number sent u64, next id u64, end id u64, moves u64, moved at u8, stage
//                 u32
//  13 result      first id u64; its length u64 and its bytes
//  14 words       their length u64 and bytes
//  15 facets      [vertex steps u64]
//                 [first corner's steps u32 | second - first u32 | third - first | labels: behind |
//                 before | sheet u32]
//  16 sheets      [first triangle u64 | number of triangles u64 | area | centroid's and box' x, y, z
//                 changed bits u64], and two texts for each: its name, and its group's; [a crease's
//                 number of edges u64 | length changed bits u64 | corner u32, of each end | sheet
//                 u32, of each side], number of corners u64; [body u32, of each side of a sheet]
//                 [a body's number of triangles u64 | of shells u64 | volume changed bits u64 | the
//                 body around it u32], and the name of each; of each sheet, its color: present u8
//                 and, if so, red, green, blue u8; [sheet u32, that a size is given for by a place]
// clang-format on
//
// A new field is serialized last, and read if `version` has it; BOOST_CLASS_VERSION raises the
// version of its record, and a golden file joins those in tests/storage/golden.

namespace locvol {
namespace {

static_assert(std::endian::native == std::endian::little, "the archive writes numbers as they are");
static_assert(std::numeric_limits<double>::is_iec559);

using Kinds =
    boost::mp11::mp_list<StoreFormat, RunRecord, LeafInfo, LeafPoints, LeafCells, LeafSurface,
                         LeafUnresolved, QueueEntry, MemoryRecord, KeySums, TimelineRecord,
                         LeafSizes, RankRecord, RankResult, RankWords, LeafFacets, SurfaceSheets>;
template <class Record>  // of Kinds
constexpr std::uint8_t kKind = boost::mp11::mp_find<Kinds, Record>::value;

constexpr PointKind last_of(PointKind) { return PointKind::kCrease; }
constexpr Initialization last_of(Initialization) { return Initialization::kPaper; }
constexpr InsideRule last_of(InsideRule) { return InsideRule::kWrap; }
constexpr Phase last_of(Phase) { return Phase::kCrease; }
constexpr ShapeKind last_of(ShapeKind) { return ShapeKind::kSegment; }
constexpr Holding last_of(Holding) { return Holding::kBeyond; }

template <class T>
concept Enumeration = std::is_enum_v<T>;

template <Enumeration T>
T enumerator(std::underlying_type_t<T> number) {
  const auto value = static_cast<T>(number);
  if (value > last_of(value)) throw DecodeError("a value that means nothing");
  return value;
}

// -- Archives of Boost.Serialization --------------------------------------------------------------

// Of what Boost.Serialization knows of a class, its version alone is written.
class ContentWriter : public boost::archive::detail::common_oarchive<ContentWriter> {
 public:
  const std::string& bytes() const { return bytes_; }
  // For `size` bytes more, which the caller writes. Valid until anything else is saved.
  char* grow(std::size_t size) {
    bytes_.resize(bytes_.size() + size);
    return bytes_.data() + bytes_.size() - size;
  }

 private:
  using Base = boost::archive::detail::common_oarchive<ContentWriter>;
  friend class boost::archive::save_access;
  friend Base;
  friend class boost::archive::detail::interface_oarchive<ContentWriter>;

  template <class Number>
  void save(const Number& number) {
    bytes_.append(reinterpret_cast<const char*>(&number), sizeof number);
  }
  void save(const std::string& text) {
    save(std::uint64_t{text.size()});
    bytes_ += text;
  }

  template <class T>
  void save_override(const T& value) {
    Base::save_override(value);
  }
  template <Enumeration T>
  void save_override(const T& value) {
    assert(value <= last_of(value));
    save(static_cast<std::underlying_type_t<T>>(value));
  }
  void save_override(const boost::archive::class_id_optional_type&) {}
  void save_override(const boost::archive::tracking_type&) {}
  void save_override(const boost::serialization::item_version_type&) {}

  std::string bytes_;
};

// Whatever the bytes say, reads nothing beyond their end, and counts no items that they cannot
// hold.
class ContentReader : public boost::archive::detail::common_iarchive<ContentReader> {
 public:
  ContentReader(std::string_view bytes, unsigned newest_version)
      : bytes_(bytes), newest_version_(newest_version) {}
  std::size_t bytes_left() const { return bytes_.size(); }
  std::string_view take(std::size_t size) {
    if (size > bytes_.size()) throw DecodeError("a record cut short");
    const std::string_view taken = bytes_.substr(0, size);
    bytes_.remove_prefix(size);
    return taken;
  }
  std::size_t load_count(std::size_t bytes_each) {
    std::uint64_t count = 0;
    load(count);
    if (count > bytes_left() / bytes_each) throw DecodeError("a list beyond its end");
    return static_cast<std::size_t>(count);
  }

 private:
  using Base = boost::archive::detail::common_iarchive<ContentReader>;
  friend class boost::archive::load_access;
  friend Base;
  friend class boost::archive::detail::interface_iarchive<ContentReader>;

  template <class Number>
  void load(Number& number) {
    take(sizeof number).copy(reinterpret_cast<char*>(&number), sizeof number);
  }
  void load(bool& value) {
    std::uint8_t number = 0;
    load(number);
    if (number > 1) throw DecodeError("a value that means nothing");
    value = number != 0;
  }
  void load(std::string& text) { text = take(load_count(1)); }
  void load(boost::serialization::collection_size_type& count) {
    count = boost::serialization::collection_size_type(load_count(1));
  }

  template <class T>
  void load_override(T& value) {
    Base::load_override(value);
  }
  template <Enumeration T>
  void load_override(T& value) {
    std::underlying_type_t<T> number = 0;
    load(number);
    value = enumerator<T>(number);
  }
  void load_override(boost::archive::version_type& version) {
    unsigned number = 0;
    load(number);
    if (number > newest_version_)
      throw DecodeError("record version " + std::to_string(number) +
                        ", which this program does not know");
    version = boost::archive::version_type(number);
  }
  void load_override(boost::archive::class_id_optional_type&) {}
  void load_override(boost::archive::tracking_type& is_tracked) { is_tracked = false; }
  void load_override(boost::serialization::item_version_type&) {}

  std::string_view bytes_;
  unsigned newest_version_;
};

// -- Columns: structure of arrays, and the differences that compress well -------------------------

// Which number of an item: the member (of a member) that is named, or the item itself; or the i-th
// element of that.
template <auto... members>
constexpr auto field = [](auto& item) -> auto& {
  return (item.*....*members);
};
template <std::size_t i, auto... members>
constexpr auto element = [](auto& item) -> auto& {
  return (item.*....*members)[i];
};
template <std::size_t i, auto coordinate>
constexpr auto of_end = [](auto& edge) -> auto& {
  return edge.ends[i].*coordinate;
};

// What is stored of it: to_bits() and from_bits(), called for item after item, undo each other.
template <class Field>
struct Plain {
  explicit Plain(Field which) : field(which) {}
  auto to_bits(const auto& item) {
    return static_cast<std::make_unsigned_t<std::remove_cvref_t<decltype(field(item))>>>(
        field(item));
  }
  void from_bits(auto& item, auto bits) {
    using Number = std::remove_cvref_t<decltype(field(item))>;
    if constexpr (Enumeration<Number>)
      field(item) = enumerator<Number>(bits);
    else
      field(item) = static_cast<Number>(bits);
  }
  Field field;
};

template <class Field>
struct Truth {
  explicit Truth(Field which) : field(which) {}
  std::uint8_t to_bits(const auto& item) { return field(item); }
  void from_bits(auto& item, std::uint8_t bits) {
    if (bits > 1) throw DecodeError("a value that means nothing");
    field(item) = bits != 0;
  }
  Field field;
};

template <class Field>
struct Steps {  // modulo 2^bits
  explicit Steps(Field which) : field(which) {}
  auto to_bits(const auto& item) {
    const auto bits = field.to_bits(item);
    return static_cast<std::remove_const_t<decltype(bits)>>(bits - std::exchange(last, bits));
  }
  void from_bits(auto& item, auto step) {
    last += step;
    field.from_bits(item, static_cast<decltype(step)>(last));
  }
  Plain<Field> field;
  std::uint64_t last = 0;
};

template <class Field>
struct ChangedBits {
  explicit ChangedBits(Field which) : field(which) {}
  auto to_bits(const auto& item) {
    using Number = std::remove_cvref_t<decltype(field(item))>;
    using Bits = std::conditional_t<sizeof(Number) == 4, std::uint32_t, std::uint64_t>;
    const auto bits = std::bit_cast<Bits>(field(item));
    return static_cast<Bits>(bits ^ std::exchange(last, bits));
  }
  void from_bits(auto& item, auto change) {
    using Number = std::remove_cvref_t<decltype(field(item))>;
    field(item) = std::bit_cast<Number>(static_cast<decltype(change)>(last ^= change));
  }
  Field field;
  std::uint64_t last = 0;
};

template <class Field>
struct KeySteps {  // of Morton keys, modulo 2^64
  explicit KeySteps(Field which) : field(which) {}
  std::uint64_t to_bits(const auto& item) {
    const std::uint64_t bits = field(item).bits();
    return bits - std::exchange(last, bits);
  }
  void from_bits(auto& item, std::uint64_t step) {
    field(item) = MortonKey::from_bits(last += step);
  }
  Field field;
  std::uint64_t last = 0;
};

template <std::size_t i, auto... members>
struct BeyondFirst {
  std::uint32_t to_bits(const auto& item) {
    return element<i, members...>(item) - element<0, members...>(item);
  }
  void from_bits(auto& item, std::uint32_t difference) {
    element<i, members...>(item) = element<0, members...>(item) + difference;
  }
};

template <class Items, class... Numbers>
struct Columns : boost::serialization::wrapper_traits<const Columns<Items, Numbers...>> {
  Columns(Items& some, Numbers... of_each) : items(some), numbers(of_each...) {}
  Items& items;
  std::tuple<Numbers...> numbers;
};
template <class Items, class... Numbers>
const Columns<Items, Numbers...> columns(Items& items, Numbers... numbers) {
  return {items, numbers...};
}

constexpr std::size_t kBlock = 256;  // values that are shuffled at a time

void save_column(ContentWriter& out, const auto& items, auto number) {
  using Bits = decltype(number.to_bits(items[0]));
  const std::size_t count = items.size();
  char* const planes = out.grow(count * sizeof(Bits));
  std::array<Bits, kBlock> block;
  for (std::size_t from = 0; from < count; from += kBlock) {
    const std::size_t num = std::min(kBlock, count - from);
    for (std::size_t i = 0; i < num; ++i) block[i] = number.to_bits(items[from + i]);
    char* plane = planes + from;
    for (std::size_t byte = 0; byte < sizeof(Bits); ++byte, plane += count)
      for (std::size_t i = 0; i < num; ++i) plane[i] = static_cast<char>(block[i] >> (8 * byte));
  }
}

void load_column(ContentReader& in, auto& items, auto number) {
  using Bits = decltype(number.to_bits(items[0]));
  const std::size_t count = items.size();
  const std::string_view planes = in.take(count * sizeof(Bits));
  for (std::size_t i = 0; i < count; ++i) {
    Bits bits = 0;
    for (std::size_t byte = 0; byte < sizeof(Bits); ++byte) {
      const auto here = static_cast<unsigned char>(planes[byte * count + i]);
      bits = static_cast<Bits>(bits | static_cast<Bits>(Bits{here} << (8 * byte)));
    }
    number.from_bits(items[i], bits);
  }
}

template <class Items, class... Numbers>
void save(ContentWriter& out, const Columns<Items, Numbers...>& list, unsigned) {
  out << std::uint64_t{list.items.size()};
  std::apply([&](auto... number) { (save_column(out, list.items, number), ...); }, list.numbers);
}

template <class Items, class... Numbers>
void load(ContentReader& in, Columns<Items, Numbers...>& list, unsigned) {
  const auto& items = list.items;
  const auto load_all = [&](auto... number) {
    list.items.resize(in.load_count((sizeof(number.to_bits(items[0])) + ...)));
    (load_column(in, list.items, number), ...);
  };
  std::apply(load_all, list.numbers);
}

template <class Archive, class Items, class... Numbers>
void serialize(Archive& archive, Columns<Items, Numbers...>& list, unsigned version) {
  boost::serialization::split_free(archive, list, version);
}

// Points by their bits: 0 and -0 differ, and so both survive.
using PointBits = std::array<std::uint64_t, 3>;

struct DistinctCorners {
  std::vector<Point> corners;
  std::vector<std::uint32_t> references;
};

DistinctCorners distinct_corners(const std::vector<Triangle>& triangles) {
  DistinctCorners distinct;
  distinct.references.reserve(3 * triangles.size());
  std::unordered_map<PointBits, std::uint32_t, TableHash> index;  // looked up, never iterated
  for (const Triangle& triangle : triangles)
    for (const Point& corner : triangle.corners) {
      const auto num_known = static_cast<std::uint32_t>(index.size());
      const auto [known, is_new] = index.try_emplace(std::bit_cast<PointBits>(corner), num_known);
      if (is_new) distinct.corners.push_back(corner);
      distinct.references.push_back(num_known - known->second);
    }
  return distinct;
}

void set_corners(std::vector<Triangle>& triangles, const DistinctCorners& distinct) {
  if (distinct.references.size() != 3 * triangles.size())
    throw DecodeError("triangles without three corners");
  auto reference = distinct.references.begin();
  std::uint32_t num_known = 0;
  for (Triangle& triangle : triangles)
    for (Point& corner : triangle.corners) {
      if (*reference > num_known || (*reference == 0 && num_known >= distinct.corners.size()))
        throw DecodeError("a triangle of unknown corners");
      corner = distinct.corners[num_known - *reference];
      if (*reference++ == 0) ++num_known;
    }
  if (num_known != distinct.corners.size()) throw DecodeError("corners of no triangle");
}

// archive & parts & ..., which the formatter would take for references.
template <class Archive, class... Parts>
void each(Archive& archive, Parts&&... parts) {
  (archive & ... & parts);
}

template <std::size_t n>
auto items_of(std::array<std::uint64_t, n>& counts) {
  return boost::serialization::make_array(counts.data(), n);
}

template <class Archive>
constexpr bool is_loading = Archive::is_loading::value;

}  // namespace

// -- What records are made of, for both directions; what is loaded is checked
// ----------------------

void serialize(auto& archive, Point& p, unsigned) { each(archive, p.x, p.y, p.z); }
void serialize(auto& archive, Box& box, unsigned) { each(archive, box.min, box.max); }

template <class Archive>
void serialize(Archive& archive, MortonKey& key, unsigned) {
  std::uint64_t bits = key.bits();
  each(archive, bits);
  if constexpr (is_loading<Archive>) key = MortonKey::from_bits(bits);
}

template <class Archive>
void serialize(Archive& archive, Frame& frame, unsigned) {
  Point origin = frame.origin();
  double unit = frame.unit();
  each(archive, origin, unit);
  if (!(unit > 0 && unit < std::numeric_limits<double>::infinity()))
    throw DecodeError("an octree frame without size");
  if constexpr (is_loading<Archive>) frame = Frame(origin, unit);
}

void serialize(auto& archive, QueuePosition& position, unsigned) {
  each(archive, position.epoch, position.color);
}

template <class T>
void serialize_optional(auto& archive, std::optional<T>& value) {
  bool is_there = value.has_value();
  each(archive, is_there);
  if (!is_there) return;
  if (!value) value.emplace();
  each(archive, *value);
}

void serialize(auto& archive, std::optional<QueuePosition>& queued, unsigned) {
  serialize_optional(archive, queued);
}

void serialize(auto& archive, LatticeCore& core, unsigned) {
  using Row = LatticeRow;
  each(archive, core.is_whole,
       columns(core.rows, Steps(field<&Row::first, &LatticeSite::i>),
               Steps(field<&Row::first, &LatticeSite::j>),
               Steps(field<&Row::first, &LatticeSite::k>), Plain(field<&Row::count>)));
  if (core.is_whole && !core.rows.empty()) throw DecodeError("rows of a core that is whole");
}

void serialize_shapes(auto& archive, std::vector<SizeShape>& shapes) {
  constexpr auto kA = &SizeShape::a, kB = &SizeShape::b;
  each(archive, columns(shapes, Plain(field<&SizeShape::kind>),
                        ChangedBits(field<&SizeShape::size>), ChangedBits(field<kA, &Point::x>),
                        ChangedBits(field<kA, &Point::y>), ChangedBits(field<kA, &Point::z>),
                        ChangedBits(field<kB, &Point::x>), ChangedBits(field<kB, &Point::y>),
                        ChangedBits(field<kB, &Point::z>), ChangedBits(field<&SizeShape::radius>)));
  for (const SizeShape& shape : shapes)
    if (!(shape.size > 0)) throw DecodeError("a shape without a size");
}

void serialize_part_sizes(auto& archive, std::vector<PartSize>& sizes) {
  each(archive, columns(sizes, ChangedBits(field<&PartSize::size>)));
  for (PartSize& part : sizes) each(archive, part.name);
}

void serialize(auto& archive, RunParameters& p, unsigned) {
  each(archive, p.input_digest, p.size, p.radius_edge_bound, p.min_dihedral, p.spacing_floor,
       p.leaf_capacity, p.init, p.seed, p.growth, p.max_size);
  serialize_shapes(archive, p.shapes);
  each(archive, p.per_circle, p.deviation, p.layers, p.min_size, p.size_image, p.image_least);
}

void serialize(auto& archive, SurfaceFacts& s, unsigned) {
  each(archive, s.file, s.num_vertices, s.num_triangles, s.num_components, s.euler_characteristic,
       s.area, s.volume, s.box, s.notes);
}

void serialize_facing(auto& archive, FacingFacts& facing) {
  each(archive, facing.num_places,
       columns(facing.places, Steps(field<&FacingPlaces::step>),
               Plain(field<&FacingPlaces::num_walls>), Plain(field<&FacingPlaces::num_rods>),
               Plain(field<&FacingPlaces::num_gaps>), Plain(field<&FacingPlaces::num_holes>)));
  if (std::ranges::adjacent_find(facing.places, std::ranges::greater_equal(),
                                 &FacingPlaces::step) != facing.places.end())
    throw DecodeError("distances out of order");
}

void serialize(auto& archive, RunCounts& counts, unsigned) {
  each(archive, counts.num_visits, counts.num_points, counts.num_cells, counts.num_unresolved,
       items_of(counts.num_insertions), counts.num_deletions, counts.num_moves);
}

// -- Records --------------------------------------------------------------------------------------

void serialize(auto& archive, StoreFormat& format, unsigned) { each(archive, format.version); }

void serialize(auto& archive, RunRecord& run, unsigned version) {
  each(archive, run.parameters, run.surface, run.frame, run.phase, run.epoch, run.next_point_id,
       run.counts, run.sizes.of_volume, run.sizes.of_area, run.image_file);
  if (version >= 1) each(archive, run.sizes.of_lattice, run.sizes.of_core);
  if (version >= 2) {
    serialize_facing(archive, run.surface.facing);
    serialize_optional(archive, run.parameters.weld);
  }
  if (version >= 3) each(archive, run.parameters.sharp_angle);
  if (version >= 4) serialize_part_sizes(archive, run.parameters.sheet_sizes);
  if (version >= 5) each(archive, run.has_creases);
  if (version >= 6)
    each(archive, run.parameters.sharp_polylines, run.sharp_file, run.parameters.has_bodies,
         run.parameters.voids, run.surface.more_files);
  if (version >= 7) serialize_part_sizes(archive, run.parameters.body_sizes);
  if (version >= 8)
    each(archive, run.parameters.gap, run.parameters.is_surface_only, run.parameters.inside);
  if (version >= 9) each(archive, run.parameters.wrap_alpha, run.parameters.wrap_offset);
}

template <class Archive>
void serialize(Archive& archive, LeafInfo& info, unsigned version) {
  bool is_inside = info.center.body() != kNoBody;
  each(archive, is_inside);
  if constexpr (is_loading<Archive>)
    info.center = is_inside ? DomainState::in(kOnlyBody) : DomainState();
  each(archive, info.num_visits, info.num_points, info.num_cells, info.num_triangles,
       items_of(info.num_insertions), info.num_deletions, info.num_moves, info.num_unresolved,
       info.queued, info.first_new_id, info.num_core_points, info.num_core_cells, info.num_left_out,
       info.least_size, info.largest_size, info.surface_size, info.reached_size);
  if (version >= 1) each(archive, info.holding);
  if (version >= 2) each(archive, columns(info.ranks, Plain(field<>)));
  if (version < 3) return;
  BodyId center = info.center.body();
  each(archive, center);
  if (center > DomainState::kMostBody) throw DecodeError("a body with too large a number");
  info.center = DomainState::in(center);
}

// Of items that the record has listed: nothing more, if all are of the only body.
template <class Archive, class Item>
void serialize_bodies(Archive& archive, bool has_others, std::vector<Item>& items, auto column) {
  const std::size_t num_items = items.size();
  if (has_others) each(archive, columns(items, column));
  if (items.size() != num_items) throw DecodeError("bodies of more or fewer than there are");
}

void serialize_bodies(auto& archive, LatticeCore& core) {
  bool has_others =
      core.body != kOnlyBody ||
      !std::ranges::all_of(
          core.rows, [](BodyId body) { return body == kOnlyBody; }, &LatticeRow::body);
  each(archive, has_others);
  serialize_bodies(archive, has_others, core.rows, Plain(field<&LatticeRow::body>));
  if (has_others) each(archive, core.body);
}

void serialize(auto& archive, LeafPoints& record, unsigned version) {
  constexpr auto kPosition = &MeshPoint::position;
  each(archive,
       columns(record.points, Steps(field<&MeshPoint::id>),
               ChangedBits(field<kPosition, &Point::x>), ChangedBits(field<kPosition, &Point::y>),
               ChangedBits(field<kPosition, &Point::z>), Plain(field<&MeshPoint::kind>)),
       record.core);
  if (version >= 1) serialize_bodies(archive, record.core);
}

void serialize(auto& archive, LeafCells& record, unsigned version) {
  each(archive, columns(record.vertices, Steps(field<>)),
       columns(record.cells, Steps(element<0>), BeyondFirst<1>(), BeyondFirst<2>(),
               BeyondFirst<3>()),
       columns(record.asked, ChangedBits(field<&Point::x>), ChangedBits(field<&Point::y>),
               ChangedBits(field<&Point::z>)));
  bool is_known = true;
  for (const auto& cell : record.cells)
    for (const std::uint32_t corner : cell) is_known &= corner < record.vertices.size();
  if (!is_known) throw DecodeError("a cell of unknown vertices");
  if (version < 1) return;
  each(archive, columns(record.bodies, Plain(field<>)));
  if (!record.bodies.empty() && record.bodies.size() != record.cells.size())
    throw DecodeError("bodies of more or fewer cells than there are");
}

void serialize(auto& archive, LeafFacets& record, unsigned) {
  constexpr auto kVertices = &MeshFacet::vertices;
  constexpr auto kLabels = &MeshFacet::labels;
  each(archive, columns(record.vertices, Steps(field<>)),
       columns(record.facets, Steps(element<0, kVertices>), BeyondFirst<1, kVertices>(),
               BeyondFirst<2, kVertices>(), Plain(field<kLabels, &FacetLabels::behind>),
               Plain(field<kLabels, &FacetLabels::before>),
               Plain(field<kLabels, &FacetLabels::sheet>)));
  const auto is_known = [&](const MeshFacet& facet) {
    return std::ranges::max(facet.vertices) < record.vertices.size();
  };
  if (!std::ranges::all_of(record.facets, is_known))
    throw DecodeError("a facet of unknown vertices");
}

void serialize_creases(auto& archive, LeafSurface& record) {
  bool has_creases = !record.creases.empty() || !record.corners.empty();
  each(archive, has_creases);
  if (!has_creases) return;
  constexpr auto kIsCorner = &CreaseEdge::is_corner;
  constexpr auto kSheets = &CreaseEdge::sheets;
  constexpr auto kPosition = &CornerPoint::position;
  each(archive,
       columns(record.creases, ChangedBits(of_end<0, &Point::x>), ChangedBits(of_end<0, &Point::y>),
               ChangedBits(of_end<0, &Point::z>), ChangedBits(of_end<1, &Point::x>),
               ChangedBits(of_end<1, &Point::y>), ChangedBits(of_end<1, &Point::z>),
               Truth(element<0, kIsCorner>), Truth(element<1, kIsCorner>),
               Plain(element<0, kSheets>), Plain(element<1, kSheets>),
               Plain(field<&CreaseEdge::crease>)),
       columns(record.corners, ChangedBits(field<kPosition, &Point::x>),
               ChangedBits(field<kPosition, &Point::y>), ChangedBits(field<kPosition, &Point::z>),
               Plain(field<&CornerPoint::corner>)));
  const auto makes_no_sense = [](const CreaseEdge& edge) {
    return !(edge.ends[0] < edge.ends[1]) || edge.crease < 1;
  };
  if (std::ranges::any_of(record.creases, makes_no_sense))
    throw DecodeError("an edge of a crease without two ends");
  if (std::ranges::adjacent_find(record.creases, std::ranges::greater_equal(), &CreaseEdge::ends) !=
          record.creases.end() ||
      std::ranges::adjacent_find(record.corners, std::ranges::greater_equal(),
                                 &CornerPoint::corner) != record.corners.end())
    throw DecodeError("creases out of order");
}

template <class Archive>
void serialize(Archive& archive, LeafSurface& record, unsigned version) {
  DistinctCorners distinct;
  if constexpr (!is_loading<Archive>) distinct = distinct_corners(record.triangles);
  each(archive, columns(record.triangles, Steps(field<&Triangle::id>)),
       columns(distinct.corners, ChangedBits(field<&Point::x>), ChangedBits(field<&Point::y>),
               ChangedBits(field<&Point::z>)),
       columns(distinct.references, Plain(field<>)));
  if constexpr (is_loading<Archive>) set_corners(record.triangles, distinct);
  if (version < 1) return;
  const std::size_t num_triangles = record.triangles.size();
  each(archive, columns(record.triangles, Plain(field<&Triangle::sheet>)));
  if (record.triangles.size() != num_triangles) throw DecodeError("triangles without a sheet");
  if (version >= 2) serialize_creases(archive, record);
  if (version < 3) return;
  bool has_others = !std::ranges::all_of(
      record.triangles, [](DomainState change) { return change == DomainState::in(kOnlyBody); },
      &Triangle::change);
  each(archive, has_others);
  serialize_bodies(archive, has_others, record.triangles, Plain([](auto& triangle) -> auto& {
                     return DomainState::member(triangle.change);
                   }));
  if (has_others && version < 4)
    throw DecodeError("several bodies, as an earlier version told them apart");
}

void serialize_color(auto& archive, std::optional<Color>& color) {
  bool is_present = color.has_value();
  each(archive, is_present);
  if (!is_present) return;
  if (!color) color.emplace();
  each(archive, color->red, color->green, color->blue);
}

void serialize(auto& archive, SurfaceSheets& record, unsigned version) {
  constexpr auto kCentroid = &SheetFacts::centroid;
  constexpr auto kBox = &SheetFacts::box;
  each(archive,
       columns(record.sheets, Plain(field<&SheetFacts::first_triangle>),
               Plain(field<&SheetFacts::num_triangles>), ChangedBits(field<&SheetFacts::area>),
               ChangedBits(field<kCentroid, &Point::x>), ChangedBits(field<kCentroid, &Point::y>),
               ChangedBits(field<kCentroid, &Point::z>),
               ChangedBits(field<kBox, &Box::min, &Point::x>),
               ChangedBits(field<kBox, &Box::min, &Point::y>),
               ChangedBits(field<kBox, &Box::min, &Point::z>),
               ChangedBits(field<kBox, &Box::max, &Point::x>),
               ChangedBits(field<kBox, &Box::max, &Point::y>),
               ChangedBits(field<kBox, &Box::max, &Point::z>)));
  for (SheetFacts& sheet : record.sheets) each(archive, sheet.name, sheet.group);
  if (version < 1) return;
  constexpr auto kCorners = &CreaseFacts::corners;
  constexpr auto kSheets = &CreaseFacts::sheets;
  each(archive,
       columns(record.creases, Plain(field<&CreaseFacts::num_edges>),
               ChangedBits(field<&CreaseFacts::length>), Plain(element<0, kCorners>),
               Plain(element<1, kCorners>), Plain(element<0, kSheets>), Plain(element<1, kSheets>)),
       record.num_corners);
  if (version < 2) return;
  constexpr auto kBodies = &SheetFacts::bodies;
  const std::size_t num_sheets = record.sheets.size();
  each(archive, columns(record.sheets, Plain(element<0, kBodies>), Plain(element<1, kBodies>)));
  if (record.sheets.size() != num_sheets) throw DecodeError("sheets without bodies");
  each(archive, columns(record.bodies, Plain(field<&BodyFacts::num_triangles>),
                        Plain(field<&BodyFacts::num_shells>),
                        ChangedBits(field<&BodyFacts::volume>), Plain(field<&BodyFacts::around>)));
  for (BodyFacts& body : record.bodies) each(archive, body.name);
  if (version < 3) return;
  for (SheetFacts& sheet : record.sheets) serialize_color(archive, sheet.color);
  each(archive, columns(record.nearest, Plain([](auto& sheet) -> auto& { return sheet; })));
}

void serialize(auto& archive, LeafUnresolved& record, unsigned) {
  constexpr auto kPosition = &UnresolvedSite::position;
  each(archive,
       columns(record.sites, Plain(field<&UnresolvedSite::condition>),
               ChangedBits(field<kPosition, &Point::x>), ChangedBits(field<kPosition, &Point::y>),
               ChangedBits(field<kPosition, &Point::z>),
               ChangedBits(field<&UnresolvedSite::radius>)));
  for (const UnresolvedSite& site : record.sites)
    if (site.condition < 1 || site.condition > kNumSiteConditions)
      throw DecodeError("a site of no known condition");
}

void serialize(auto& archive, LeafSizes& record, unsigned) {
  constexpr auto kDistance = &SizeCube::distance;
  constexpr auto kLess = &SizeCube::less;
  each(archive,
       columns(record.cubes, KeySteps(field<&SizeCube::key>), ChangedBits(element<0, kDistance>),
               ChangedBits(element<1, kDistance>), ChangedBits(element<2, kDistance>),
               ChangedBits(element<3, kDistance>), ChangedBits(element<4, kDistance>),
               ChangedBits(element<5, kDistance>), ChangedBits(element<6, kDistance>),
               ChangedBits(element<7, kDistance>), ChangedBits(field<&SizeCube::excess>),
               ChangedBits(element<0, kLess>), ChangedBits(element<1, kLess>),
               ChangedBits(element<2, kLess>), ChangedBits(element<3, kLess>),
               ChangedBits(element<4, kLess>), ChangedBits(element<5, kLess>),
               ChangedBits(element<6, kLess>), ChangedBits(element<7, kLess>)),
       columns(record.nodes, KeySteps(field<&SizedNode::key>),
               ChangedBits(field<&SizedNode::size>)));
  for (const SizedNode& node : record.nodes)
    if (!node.key.is_valid() || !(node.size > 0)) throw DecodeError("a node without a size");
  const SizeCube* previous = nullptr;
  for (const SizeCube& cube : record.cubes) {
    if (!cube.key.is_valid() || (previous && previous->key.range_max() >= cube.key.range_min()))
      throw DecodeError("cubes of sizes out of order");
    const auto is_finite = [](float d) { return std::isfinite(d); };
    if (!std::isfinite(cube.excess) || !std::ranges::all_of(cube.distance, is_finite) ||
        !std::ranges::all_of(cube.less, is_finite))
      throw DecodeError("a cube of sizes without a distance");
    previous = &cube;
  }
}

void serialize(auto& archive, QueueEntry& entry, unsigned) {
  each(archive, entry.position, entry.leaf);
}

void serialize(auto& archive, MemoryRecord& m, unsigned) {
  each(archive, m.cap, m.program, m.leaves, m.commits, m.visits, m.cache, m.peak_resident);
}

void serialize(auto& archive, KeySums& keys, unsigned) {
  each(archive, columns(keys.sums, Plain(field<>)));
}

void serialize(auto& archive, RankResult& result, unsigned) {
  each(archive, result.first_id, result.bytes);
}

void serialize(auto& archive, RankRecord& record, unsigned version) {
  if (version < 1)
    throw DecodeError("an older locvol's, whose runs by several processes end there");
  each(archive, columns(record.first, KeySteps(field<>)), record.rank, record.superstep,
       record.applied, record.is_all_sent, record.num_sent, record.next_id, record.end_id,
       record.num_moves, record.moved_at, record.stage);
}

void serialize(auto& archive, RankWords& words, unsigned) { each(archive, words.said); }

void serialize(auto& archive, TimelineRecord& record, unsigned) {
  using Sample = TimelineSample;
  constexpr auto kCounts = &Sample::counts;
  constexpr auto kInsertions = &RunCounts::num_insertions;
  each(archive,
       columns(record.samples, Steps(field<&Sample::milliseconds>), Steps(field<&Sample::sitting>),
               Steps(field<&Sample::started>), Steps(field<&Sample::num_threads>),
               Steps(field<&Sample::memory_cap>), Steps(field<&Sample::resident>),
               Steps(field<&Sample::epoch>), Steps(field<&Sample::num_leaves>),
               Steps(field<&Sample::num_queued>), Steps(field<kCounts, &RunCounts::num_visits>),
               Steps(field<kCounts, &RunCounts::num_points>),
               Steps(field<kCounts, &RunCounts::num_cells>),
               Steps(field<kCounts, &RunCounts::num_unresolved>),
               Steps(field<kCounts, &RunCounts::num_deletions>),
               Steps(field<kCounts, &RunCounts::num_moves>),
               Steps(element<0, kCounts, kInsertions>), Steps(element<1, kCounts, kInsertions>),
               Steps(element<2, kCounts, kInsertions>), Steps(element<3, kCounts, kInsertions>),
               Steps(element<4, kCounts, kInsertions>), Steps(element<5, kCounts, kInsertions>),
               Steps(element<6, kCounts, kInsertions>), Plain(field<&Sample::phase>)));
}

}  // namespace locvol

// Parts of records come without a version of their own.
BOOST_CLASS_VERSION(locvol::RunRecord, 9)
BOOST_CLASS_VERSION(locvol::LeafInfo, 3)
BOOST_CLASS_VERSION(locvol::LeafPoints, 1)
BOOST_CLASS_VERSION(locvol::LeafCells, 1)
BOOST_CLASS_VERSION(locvol::LeafSurface, 4)
BOOST_CLASS_VERSION(locvol::SurfaceSheets, 3)
BOOST_CLASS_VERSION(locvol::RankRecord, 1)
BOOST_CLASS_IMPLEMENTATION(locvol::Point, object_serializable)
BOOST_CLASS_IMPLEMENTATION(locvol::Box, object_serializable)
BOOST_CLASS_IMPLEMENTATION(locvol::MortonKey, object_serializable)
BOOST_CLASS_IMPLEMENTATION(locvol::Frame, object_serializable)
BOOST_CLASS_IMPLEMENTATION(locvol::QueuePosition, object_serializable)
BOOST_CLASS_IMPLEMENTATION(std::optional<locvol::QueuePosition>, object_serializable)
BOOST_CLASS_IMPLEMENTATION(locvol::LatticeCore, object_serializable)
BOOST_CLASS_IMPLEMENTATION(locvol::RunParameters, object_serializable)
BOOST_CLASS_IMPLEMENTATION(locvol::SurfaceFacts, object_serializable)
BOOST_CLASS_IMPLEMENTATION(locvol::RunCounts, object_serializable)
BOOST_CLASS_IMPLEMENTATION(std::vector<std::string>, object_serializable)

namespace locvol {
namespace {

// -- zstd -----------------------------------------------------------------------------------------

// Measured with storage_benchmark: level 3 saves 6% of cells in random order and nothing of points,
// at 70% of the speed; level 6 saves 10% and 2%, at a third of it. All over level 1, which in a run
// takes a third longer than -1, and saves 2%.
constexpr int kCompressionLevel = -1;

struct FreeContext {
  void operator()(ZSTD_CCtx* context) const { ZSTD_freeCCtx(context); }
  void operator()(ZSTD_DCtx* context) const { ZSTD_freeDCtx(context); }
};
using Compressor = std::unique_ptr<ZSTD_CCtx, FreeContext>;
using Decompressor = std::unique_ptr<ZSTD_DCtx, FreeContext>;

// Contexts that are not in use, for the next one who needs one. (Kept per thread, they would need a
// destructor per thread, for which the C library takes memory or ends the program.)
template <class Context>
class ContextPool {
 public:
  class Lease {
   public:
    Lease(ContextPool& pool, Context context) : pool_(pool), context_(std::move(context)) {}
    Lease(const Lease&) = delete;
    Lease& operator=(const Lease&) = delete;
    ~Lease() {
      const std::lock_guard lock(pool_.mutex_);
      pool_.idle_.push_back(std::move(context_));  // there is room
    }
    auto* get() const { return context_.get(); }

   private:
    ContextPool& pool_;
    Context context_;
  };

  Lease lease(Context (*make)()) {
    const std::lock_guard lock(mutex_);
    if (idle_.empty()) {
      idle_.reserve(num_contexts_ + 1);
      idle_.push_back(make());
      ++num_contexts_;
    }
    Context context = std::move(idle_.back());
    idle_.pop_back();
    return Lease(*this, std::move(context));
  }

 private:
  std::mutex mutex_;
  std::vector<Context> idle_;
  std::size_t num_contexts_ = 0;  // idle and leased
};

Compressor make_compressor() {
  Compressor compressor(ZSTD_createCCtx());
  if (!compressor) throw std::bad_alloc();
  ZSTD_CCtx_setParameter(compressor.get(), ZSTD_c_compressionLevel, kCompressionLevel);
  ZSTD_CCtx_setParameter(compressor.get(), ZSTD_c_checksumFlag, 1);
  return compressor;
}

Decompressor make_decompressor() {
  Decompressor decompressor(ZSTD_createDCtx());
  if (!decompressor) throw std::bad_alloc();
  return decompressor;
}

std::string compress(const std::string& content) {
  static ContextPool<Compressor> pool;
  const auto compressor = pool.lease(make_compressor);
  std::string frame(ZSTD_compressBound(content.size()), '\0');
  const std::size_t size =
      ZSTD_compress2(compressor.get(), frame.data(), frame.size(), content.data(), content.size());
  if (ZSTD_isError(size)) throw std::bad_alloc();  // all that is left to fail
  frame.resize(size);
  frame.shrink_to_fit();  // batches keep it
  return frame;
}

constexpr std::size_t kDescriptor = 4;  // in a frame, after its magic number

struct Content {
  std::unique_ptr<char[]> bytes;
  std::size_t size = 0;
  std::string_view view() const { return {bytes.get(), size}; }
};

// The most that a frame's blocks can hold, from their headers (RFC 8878, section 3.1.1):
//
// clang-format off
//   | magic u32 | descriptor u8 | window u8, if not a single segment |
//   | dictionary 0, 1, 2 or 4 bytes | content size 0, 1, 2, 4 or 8 bytes |
//   | blocks ... | checksum u32 |
// clang-format on
//
// A block is | last 1 bit, type 2 bits, size 21 bits | bytes ... |: `size` bytes as they are, one
// byte to be repeated `size` times, or `size` bytes compressed, which give 128 KB at most.
std::uint64_t max_content_size(std::string_view frame) {
  constexpr std::uint64_t kMaxBlock = std::uint64_t{128} << 10;
  constexpr std::size_t kBlockHeader = 3;
  enum BlockType { kRaw, kRepeated, kCompressed };
  const auto byte_at = [&](std::size_t i) { return static_cast<unsigned char>(frame[i]); };
  const unsigned descriptor = byte_at(kDescriptor);
  const bool is_single_segment = (descriptor & 0x20) != 0;
  const std::array<std::size_t, 4> dictionary{0, 1, 2, 4}, content{is_single_segment, 2, 4, 8};
  std::size_t at = kDescriptor + 1 + (is_single_segment ? 0 : 1) + dictionary[descriptor & 3] +
                   content[descriptor >> 6];
  std::uint64_t most = 0;
  for (bool is_last = false; !is_last;) {
    if (at + kBlockHeader > frame.size()) throw DecodeError("a frame cut short");
    const std::uint32_t header =
        byte_at(at) | std::uint32_t{byte_at(at + 1)} << 8 | std::uint32_t{byte_at(at + 2)} << 16;
    const std::uint32_t type = header >> 1 & 3, size = header >> 3;
    is_last = (header & 1) != 0;
    most += type == kCompressed ? kMaxBlock : std::min<std::uint64_t>(size, kMaxBlock);
    at += kBlockHeader + (type == kRepeated ? 1 : size);
  }
  return most;
}

// The content size is part of the frame's header, which the checksum does not cover. So it is held
// against what the blocks can hold, before memory is asked for.
std::size_t believable_content_size(std::string_view frame) {
  const unsigned long long size = ZSTD_getFrameContentSize(frame.data(), frame.size());
  if (size == ZSTD_CONTENTSIZE_ERROR) throw DecodeError("not a zstd frame");
  if (size == ZSTD_CONTENTSIZE_UNKNOWN || size > max_content_size(frame))
    throw DecodeError("no believable size");
  return static_cast<std::size_t>(size);
}

Content decompress(std::string_view frame) {
  constexpr char kHasChecksum = 0x04;
  static ContextPool<Decompressor> pool;
  const auto decompressor = pool.lease(make_decompressor);
  Content content{nullptr, believable_content_size(frame)};
  if ((frame[kDescriptor] & kHasChecksum) == 0) throw DecodeError("no checksum");
  content.bytes = std::make_unique_for_overwrite<char[]>(content.size);
  const std::size_t size = ZSTD_decompressDCtx(decompressor.get(), content.bytes.get(),
                                               content.size, frame.data(), frame.size());
  if (ZSTD_isError(size)) throw DecodeError(ZSTD_getErrorName(size));
  if (size != content.size) throw DecodeError("not of the size it claims");
  return content;
}

}  // namespace

template <class Record>
std::string encode(const Record& record, MortonKey leaf) {
  ContentWriter out;
  out << kKind<Record> << leaf << record;
  return compress(out.bytes());
}

template <class Record>
Record decode(std::string_view bytes, MortonKey leaf) {
  const Content content = decompress(bytes);
  ContentReader in(content.view(), boost::serialization::version<Record>::value);
  std::uint8_t kind = 0;
  MortonKey stored_leaf;
  in >> kind >> stored_leaf;
  if (kind != kKind<Record>) throw DecodeError("a record of another kind");
  if (stored_leaf != leaf) throw DecodeError("a record of another leaf");
  Record record;
  in >> record;
  if (in.bytes_left() != 0) throw DecodeError("bytes left over");
  return record;
}

template std::string encode(const StoreFormat&, MortonKey);
template std::string encode(const RunRecord&, MortonKey);
template std::string encode(const LeafInfo&, MortonKey);
template std::string encode(const LeafPoints&, MortonKey);
template std::string encode(const LeafCells&, MortonKey);
template std::string encode(const LeafFacets&, MortonKey);
template std::string encode(const LeafSurface&, MortonKey);
template std::string encode(const LeafUnresolved&, MortonKey);
template std::string encode(const QueueEntry&, MortonKey);
template std::string encode(const MemoryRecord&, MortonKey);
template std::string encode(const KeySums&, MortonKey);
template std::string encode(const TimelineRecord&, MortonKey);
template std::string encode(const LeafSizes&, MortonKey);
template std::string encode(const RankRecord&, MortonKey);
template std::string encode(const RankResult&, MortonKey);
template std::string encode(const RankWords&, MortonKey);
template std::string encode(const SurfaceSheets&, MortonKey);
template StoreFormat decode(std::string_view, MortonKey);
template RunRecord decode(std::string_view, MortonKey);
template LeafInfo decode(std::string_view, MortonKey);
template LeafPoints decode(std::string_view, MortonKey);
template LeafCells decode(std::string_view, MortonKey);
template LeafFacets decode(std::string_view, MortonKey);
template LeafSurface decode(std::string_view, MortonKey);
template LeafUnresolved decode(std::string_view, MortonKey);
template QueueEntry decode(std::string_view, MortonKey);
template MemoryRecord decode(std::string_view, MortonKey);
template KeySums decode(std::string_view, MortonKey);
template TimelineRecord decode(std::string_view, MortonKey);
template LeafSizes decode(std::string_view, MortonKey);
template RankRecord decode(std::string_view, MortonKey);
template RankResult decode(std::string_view, MortonKey);
template RankWords decode(std::string_view, MortonKey);
template SurfaceSheets decode(std::string_view, MortonKey);

}  // namespace locvol
