#include "storage/codec.h"

#include <zstd.h>

#include <algorithm>
#include <array>
#include <bit>
#include <boost/archive/archive_exception.hpp>
#include <boost/archive/binary_iarchive.hpp>
#include <boost/archive/binary_oarchive.hpp>
#include <cassert>
#include <concepts>
#include <limits>
#include <memory>
#include <mutex>
#include <new>
#include <streambuf>
#include <type_traits>
#include <unordered_map>
#include <utility>
#include <vector>

// The bytes of a record
// =====================
// A record is one zstd frame (RFC 8878) with content size and content checksum (XXH64). In it:
//
//   | kind u8 | version u16 | leaf u64 | fields ... |          (a Boost binary archive, no header)
//
// Numbers are little-endian and unpadded, bool and enumerations u8, double 8 bytes, text a column
// of characters. A column holds many values of one kind, lowest bytes first (byte-shuffled), for
// neighbors differ in their low bytes only and zstd finds the runs in the high ones:
//
//   | count u64 | byte 0 of every value | byte 1 of every value | ... |
//
// Fields (columns in brackets; "steps" are differences to the value before, "changed bits" the
// exclusive or with it, both from 0):
//
// clang-format off
//   0 format      version u32
//   1 run         parameters, surface facts, frame, progress: in the order of fields() below
//   2 leaf        the fields of LeafInfo in order; `queued` as present u8, epoch u32, color u32
//   3 points      [id steps u64] [x] [y] [z: changed bits u64] [kind u8]; the core: whole u8,
//                 [i] [j] [k of the rows' first sites, steps u32] [counts u32]
//   4 cells       [vertex steps u64] [first corners, steps u32] [second - first u32]
//                 [third - first] [fourth - first]
//   5 surface     [id steps u64] [x] [y] [z of each distinct corner, in order of appearance:
//                 changed bits u64] [references u32, three to a triangle:
//                 distinct corners so far - index; 0 is the next new one]
//   6 unresolved  [condition u8] [x] [y] [z] [radius: changed bits u64]
//   7 queue       position, leaf, dirty box
//   8 memory      the fields of MemoryRecord in order
//   9 keys        [sums u64]
//  10 timeline    [each number of a TimelineSample in order, steps u64], and last [phase u8]
// clang-format on
//
// A change of fields raises the version of that kind and adds a golden file (tests/storage/golden).

namespace locvol {
namespace {

static_assert(std::endian::native == std::endian::little, "the archive writes numbers as they are");
static_assert(std::numeric_limits<double>::is_iec559);

// -- Kinds of records ----------------------------------------------------------------------------

struct Kind {
  std::uint8_t number;
  std::uint16_t version;
};
template <class Record>
inline constexpr Kind kKind{};
template <>
inline constexpr Kind kKind<StoreFormat>{0, 1};
template <>
inline constexpr Kind kKind<RunRecord>{1, 1};
template <>
inline constexpr Kind kKind<LeafInfo>{2, 1};
template <>
inline constexpr Kind kKind<LeafPoints>{3, 1};
template <>
inline constexpr Kind kKind<LeafCells>{4, 1};
template <>
inline constexpr Kind kKind<LeafSurface>{5, 1};
template <>
inline constexpr Kind kKind<LeafUnresolved>{6, 1};
template <>
inline constexpr Kind kKind<QueueEntry>{7, 1};
template <>
inline constexpr Kind kKind<MemoryRecord>{8, 1};
template <>
inline constexpr Kind kKind<KeySums>{9, 1};
template <>
inline constexpr Kind kKind<TimelineRecord>{10, 1};

constexpr PointKind last_of(PointKind) { return PointKind::kLattice; }
constexpr Initialization last_of(Initialization) { return Initialization::kPaper; }
constexpr Phase last_of(Phase) { return Phase::kMend; }

// -- Archives ------------------------------------------------------------------------------------

constexpr unsigned kArchiveFlags = boost::archive::no_header | boost::archive::no_codecvt |
                                   boost::archive::no_xml_tag_checking |
                                   boost::archive::no_tracking;

class AppendBuffer : public std::streambuf {
 public:
  const std::string& bytes() const { return bytes_; }
  // For `size` bytes more, which the caller writes. Valid until anything else is appended.
  char* grow(std::size_t size) {
    bytes_.resize(bytes_.size() + size);
    return bytes_.data() + bytes_.size() - size;
  }

 private:
  std::streamsize xsputn(const char* data, std::streamsize size) override {
    bytes_.append(data, static_cast<std::size_t>(size));
    return size;
  }
  int_type overflow(int_type c) override {
    if (!traits_type::eq_int_type(c, traits_type::eof())) bytes_ += traits_type::to_char_type(c);
    return traits_type::not_eof(c);
  }

  std::string bytes_;
};

class ViewBuffer : public std::streambuf {
 public:
  explicit ViewBuffer(std::string_view bytes) {
    char* const begin = const_cast<char*>(bytes.data());  // a streambuf that only reads
    setg(begin, begin, begin + bytes.size());
  }
  std::size_t bytes_left() const { return static_cast<std::size_t>(egptr() - gptr()); }
  // The next bytes. REQUIRES: there are as many
  const char* take(std::size_t size) {
    const char* const begin = gptr();
    setg(eback(), gptr() + size, egptr());
    return begin;
  }
};

template <class T>
concept Number = (std::integral<T> && !std::same_as<T, bool>) || std::same_as<T, double>;
template <class T>
concept Enumeration = std::is_enum_v<T>;
template <class T, class Record>
concept Maybe = std::same_as<std::remove_const_t<T>, Record>;  // Record or const Record

// Writes fields in the order they are named: out(a, b, c). A struct is its fields().
class ContentWriter {
 public:
  template <class... Fields>
  void operator()(const Fields&... values) {
    (put(values), ...);
  }
  const std::string& bytes() const { return buffer_.bytes(); }

 private:
  template <Number T>
  void put(const T& value) {
    archive_.save_binary(&value, sizeof value);
  }
  template <Enumeration T>
  void put(const T& value) {
    assert(value <= last_of(value));
    put(static_cast<std::underlying_type_t<T>>(value));
  }
  void put(const bool& value) { put(static_cast<std::uint8_t>(value)); }
  void put(const MortonKey& key) { put(key.bits()); }
  void put(const std::string& text) { put_column(text.data(), text.size()); }
  template <std::unsigned_integral T>
  void put(const std::vector<T>& column) {
    put_column(column.data(), column.size());
  }
  void put(const std::vector<std::string>& texts) {
    put(std::uint64_t{texts.size()});
    for (const std::string& text : texts) put(text);
  }
  template <class T, std::size_t N>
  void put(const std::array<T, N>& values) {
    for (const T& value : values) put(value);
  }
  void put(const Frame& frame) { (*this)(frame.origin(), frame.unit()); }
  template <class Struct>
  void put(const Struct& record) {
    fields(*this, record);
  }

  template <class T>
  void put_column(const T* values, std::size_t count);

  AppendBuffer buffer_;
  boost::archive::binary_oarchive archive_{buffer_, kArchiveFlags};
};

template <class T>
void ContentWriter::put_column(const T* values, std::size_t count) {
  put(std::uint64_t{count});
  char* plane = buffer_.grow(count * sizeof(T));
  for (std::size_t byte = 0; byte < sizeof(T); ++byte, plane += count)
    for (std::size_t i = 0; i < count; ++i) plane[i] = static_cast<char>(values[i] >> (8 * byte));
}

// Reads fields in the order they are named. Sizes are checked against the bytes left before
// anything is allocated.
class ContentReader {
 public:
  explicit ContentReader(std::string_view content) : buffer_(content) {}
  template <class... Fields>
  void operator()(Fields&... values) {
    (get(values), ...);
  }
  bool is_at_end() const { return buffer_.bytes_left() == 0; }

 private:
  template <Number T>
  void get(T& value) {
    archive_.load_binary(&value, sizeof value);
  }
  template <Enumeration T>
  void get(T& value) {
    std::underlying_type_t<T> number = 0;
    get(number);
    value = static_cast<T>(number);
    if (value > last_of(value)) throw DecodeError("a value that means nothing");
  }
  void get(bool& value) {
    std::uint8_t number = 0;
    get(number);
    if (number > 1) throw DecodeError("a value that means nothing");
    value = number != 0;
  }
  void get(MortonKey& key) {
    std::uint64_t bits = 0;
    get(bits);
    key = MortonKey::from_bits(bits);
  }
  void get(std::string& text) { get_column(text); }
  template <std::unsigned_integral T>
  void get(std::vector<T>& column) {
    get_column(column);
  }
  void get(std::vector<std::string>& texts) {
    texts.resize(get_count(sizeof(std::uint64_t)));
    for (std::string& text : texts) get(text);
  }
  template <class T, std::size_t N>
  void get(std::array<T, N>& values) {
    for (T& value : values) get(value);
  }
  void get(Frame& frame) {
    Point origin;
    double unit = 0;
    (*this)(origin, unit);
    if (!(unit > 0 && unit < std::numeric_limits<double>::infinity()))
      throw DecodeError("an octree frame without size");
    frame = Frame(origin, unit);
  }
  template <class Struct>
  void get(Struct& record) {
    fields(*this, record);
  }

  std::size_t get_count(std::size_t bytes_each) {
    std::uint64_t count = 0;
    get(count);
    if (count > buffer_.bytes_left() / bytes_each) throw DecodeError("a list beyond its end");
    return static_cast<std::size_t>(count);
  }
  template <class Column>
  void get_column(Column& column);

  ViewBuffer buffer_;
  boost::archive::binary_iarchive archive_{buffer_, kArchiveFlags};
};

template <class Column>
void ContentReader::get_column(Column& column) {
  using T = typename Column::value_type;
  using Bits = std::make_unsigned_t<T>;
  const std::size_t count = get_count(sizeof(T));
  column.resize(count);
  const char* const planes = buffer_.take(count * sizeof(T));
  for (std::size_t i = 0; i < count; ++i) {
    Bits bits = 0;
    for (std::size_t byte = 0; byte < sizeof(T); ++byte) {
      const auto here = static_cast<unsigned char>(planes[byte * count + i]);
      bits = static_cast<Bits>(bits | static_cast<Bits>(Bits{here} << (8 * byte)));
    }
    column[i] = static_cast<T>(bits);
  }
}

// -- Fields of the plain structs: one list for both directions ------------------------------------

void fields(auto& archive, Maybe<Point> auto& p) { archive(p.x, p.y, p.z); }
void fields(auto& archive, Maybe<Box> auto& box) { archive(box.min, box.max); }
void fields(auto& archive, Maybe<QueuePosition> auto& p) { archive(p.epoch, p.color); }
void fields(auto& archive, Maybe<StoreFormat> auto& format) { archive(format.version); }
void fields(auto& archive, Maybe<KeySums> auto& keys) { archive(keys.sums); }

void fields(auto& archive, Maybe<QueueEntry> auto& entry) {
  archive(entry.position, entry.leaf, entry.dirty);
}

void fields(auto& archive, Maybe<RunParameters> auto& p) {
  archive(p.input_digest, p.size, p.radius_edge_bound, p.spacing_floor, p.leaf_capacity, p.init,
          p.seed);
}

void fields(auto& archive, Maybe<SurfaceFacts> auto& s) {
  archive(s.file, s.num_vertices, s.num_triangles, s.num_components, s.euler_characteristic, s.area,
          s.volume, s.box, s.notes);
}

void fields(auto& archive, Maybe<RunRecord> auto& run) {
  archive(run.parameters, run.surface, run.frame, run.phase, run.epoch, run.next_point_id,
          run.num_visits, run.num_points, run.num_cells, run.num_unresolved, run.num_insertions,
          run.num_deletions);
}

void fields(auto& archive, Maybe<MemoryRecord> auto& m) {
  archive(m.cap, m.program, m.leaves, m.commits, m.visits, m.cache, m.peak_resident);
}

// LeafInfo as stored: the optional is a flag and a value that is 0 when absent.
struct StoredLeafInfo {
  LeafInfo info;  // `queued` is not looked at
  bool is_queued = false;
  QueuePosition position;
};

void fields(auto& archive, Maybe<StoredLeafInfo> auto& leaf) {
  auto& info = leaf.info;
  archive(info.is_center_inside, info.num_visits, info.num_points, info.num_cells,
          info.num_triangles, info.num_insertions, info.num_deletions, info.num_unresolved,
          leaf.is_queued, leaf.position, info.first_new_id, info.num_core_points,
          info.num_core_cells, info.num_left_out);
}

struct PositionColumns {
  std::vector<std::uint64_t> x, y, z;  // changed bits
};

struct CoreColumns {
  bool is_whole = false;
  std::vector<std::uint32_t> i, j, k;  // steps
  std::vector<std::uint32_t> counts;
};

struct PointColumns {
  std::vector<std::uint64_t> ids;  // steps
  PositionColumns positions;
  std::vector<std::uint8_t> kinds;
  CoreColumns core;
};

struct CellColumns {
  std::vector<std::uint64_t> vertices;                // steps
  std::array<std::vector<std::uint32_t>, 4> corners;  // steps; the others minus the first
};

struct TriangleColumns {
  std::vector<std::uint64_t> ids;  // steps
  PositionColumns corners;
  std::vector<std::uint32_t> references;
};

struct SiteColumns {
  std::vector<std::uint8_t> conditions;
  PositionColumns positions;
  std::vector<std::uint64_t> radii;  // changed bits
};

// The numbers of a sample, in the order in which they are stored.
constexpr std::size_t kNumSampleNumbers = 14 + kNumConditions;
auto numbers_of(Maybe<TimelineSample> auto& s) {
  using Number = std::conditional_t<std::is_const_v<std::remove_reference_t<decltype(s)>>,
                                    const std::uint64_t, std::uint64_t>;
  std::array<Number*, kNumSampleNumbers> numbers{
      &s.milliseconds, &s.sitting,   &s.started,        &s.num_threads,  &s.memory_cap,
      &s.resident,     &s.epoch,     &s.num_leaves,     &s.num_queued,   &s.num_visits,
      &s.num_points,   &s.num_cells, &s.num_unresolved, &s.num_deletions};
  for (std::size_t c = 0; c < kNumConditions; ++c)
    numbers[kNumSampleNumbers - kNumConditions + c] = &s.num_insertions[c];
  return numbers;
}

struct SampleColumns {
  std::array<std::vector<std::uint64_t>, kNumSampleNumbers> numbers;  // steps
  std::vector<std::uint8_t> phases;
};
void fields(auto& archive, Maybe<SampleColumns> auto& c) { archive(c.numbers, c.phases); }

void fields(auto& archive, Maybe<PositionColumns> auto& c) { archive(c.x, c.y, c.z); }
void fields(auto& archive, Maybe<CoreColumns> auto& c) {
  archive(c.is_whole, c.i, c.j, c.k, c.counts);
}
void fields(auto& archive, Maybe<PointColumns> auto& c) {
  archive(c.ids, c.positions, c.kinds, c.core);
}
void fields(auto& archive, Maybe<CellColumns> auto& c) { archive(c.vertices, c.corners); }
void fields(auto& archive, Maybe<TriangleColumns> auto& c) {
  archive(c.ids, c.corners, c.references);
}
void fields(auto& archive, Maybe<SiteColumns> auto& c) {
  archive(c.conditions, c.positions, c.radii);
}

// -- Columns: structure of arrays, and the differences that compress well -------------------------

template <class T>
class Steps {  // to_step and to_value, called in turn, undo each other; arithmetic modulo 2^bits
 public:
  T to_step(T value) { return static_cast<T>(value - std::exchange(last_, value)); }
  T to_value(T step) { return last_ = static_cast<T>(last_ + step); }

 private:
  T last_ = 0;
};

class ChangedBits {
 public:
  std::uint64_t to_change(double value) {
    const auto bits = std::bit_cast<std::uint64_t>(value);
    return bits ^ std::exchange(last_, bits);
  }
  double to_value(std::uint64_t change) { return std::bit_cast<double>(last_ ^= change); }

 private:
  std::uint64_t last_ = 0;
};

class PositionWriter {
 public:
  // `num`: of positions that may come
  PositionWriter(PositionColumns& columns, std::size_t num) : columns_(columns) {
    for (auto* column : {&columns_.x, &columns_.y, &columns_.z}) column->reserve(num);
  }
  void add(const Point& p) {
    columns_.x.push_back(x_.to_change(p.x));
    columns_.y.push_back(y_.to_change(p.y));
    columns_.z.push_back(z_.to_change(p.z));
  }

 private:
  PositionColumns& columns_;
  ChangedBits x_, y_, z_;
};

void check_length(std::size_t length, std::size_t expected) {
  if (length != expected) throw DecodeError("lists of different lengths");
}

std::vector<Point> positions_of(const PositionColumns& columns) {
  const std::size_t count = columns.x.size();
  check_length(columns.y.size(), count);
  check_length(columns.z.size(), count);
  std::vector<Point> positions(count);
  ChangedBits x, y, z;
  for (std::size_t i = 0; i < count; ++i) {
    positions[i] = {x.to_value(columns.x[i]), y.to_value(columns.y[i]), z.to_value(columns.z[i])};
  }
  return positions;
}

CoreColumns columns_of(const LatticeCore& core) {
  CoreColumns columns;
  columns.is_whole = core.is_whole;
  Steps<std::uint32_t> i, j, k;
  for (const auto& [first, count] : core.rows) {
    columns.i.push_back(i.to_step(static_cast<std::uint32_t>(first.i)));
    columns.j.push_back(j.to_step(static_cast<std::uint32_t>(first.j)));
    columns.k.push_back(k.to_step(static_cast<std::uint32_t>(first.k)));
    columns.counts.push_back(count);
  }
  return columns;
}

LatticeCore core_of(const CoreColumns& columns) {
  for (const auto* column : {&columns.j, &columns.k, &columns.counts})
    check_length(column->size(), columns.i.size());
  LatticeCore core{.is_whole = columns.is_whole, .rows = {}};
  if (core.is_whole && !columns.i.empty()) throw DecodeError("rows of a core that is whole");
  core.rows.reserve(columns.i.size());
  Steps<std::uint32_t> i, j, k;
  for (std::size_t n = 0; n < columns.i.size(); ++n)
    core.rows.push_back({{static_cast<std::int32_t>(i.to_value(columns.i[n])),
                          static_cast<std::int32_t>(j.to_value(columns.j[n])),
                          static_cast<std::int32_t>(k.to_value(columns.k[n]))},
                         columns.counts[n]});
  return core;
}

PointColumns stored_form(const LeafPoints& record) {
  PointColumns columns;
  columns.core = columns_of(record.core);
  Steps<std::uint64_t> ids;
  PositionWriter positions(columns.positions, record.points.size());
  columns.ids.reserve(record.points.size());
  columns.kinds.reserve(record.points.size());
  for (const MeshPoint& point : record.points) {
    assert(point.kind <= last_of(point.kind));
    columns.ids.push_back(ids.to_step(point.id));
    positions.add(point.position);
    columns.kinds.push_back(static_cast<std::uint8_t>(point.kind));
  }
  return columns;
}

LeafPoints record_of(const PointColumns& columns) {
  const std::vector<Point> positions = positions_of(columns.positions);
  check_length(columns.ids.size(), positions.size());
  check_length(columns.kinds.size(), positions.size());
  LeafPoints record;
  record.core = core_of(columns.core);
  record.points.reserve(positions.size());
  Steps<std::uint64_t> ids;
  for (std::size_t i = 0; i < positions.size(); ++i) {
    const auto kind = static_cast<PointKind>(columns.kinds[i]);
    if (kind > last_of(kind)) throw DecodeError("a point of no known kind");
    record.points.push_back({ids.to_value(columns.ids[i]), positions[i], kind});
  }
  return record;
}

CellColumns stored_form(const LeafCells& record) {
  CellColumns columns;
  Steps<std::uint64_t> ids;
  columns.vertices.reserve(record.vertices.size());
  for (const std::uint64_t id : record.vertices) columns.vertices.push_back(ids.to_step(id));
  Steps<std::uint32_t> first;
  for (auto& corners : columns.corners) corners.resize(record.cells.size());
  for (std::size_t c = 0; c < record.cells.size(); ++c) {
    const auto& cell = record.cells[c];
    assert(std::ranges::all_of(cell, [&](auto corner) { return corner < record.vertices.size(); }));
    columns.corners[0][c] = first.to_step(cell[0]);
    for (std::size_t i = 1; i < 4; ++i) columns.corners[i][c] = cell[i] - cell[0];
  }
  return columns;
}

LeafCells record_of(const CellColumns& columns) {
  LeafCells record;
  record.vertices.reserve(columns.vertices.size());
  Steps<std::uint64_t> ids;
  for (const std::uint64_t step : columns.vertices) record.vertices.push_back(ids.to_value(step));
  for (const auto& corners : columns.corners)
    check_length(corners.size(), columns.corners[0].size());
  record.cells.resize(columns.corners[0].size());
  Steps<std::uint32_t> first;
  for (std::size_t c = 0; c < record.cells.size(); ++c) {
    auto& cell = record.cells[c];
    cell[0] = first.to_value(columns.corners[0][c]);
    for (std::size_t i = 1; i < 4; ++i) cell[i] = columns.corners[i][c] + cell[0];
    for (const std::uint32_t corner : cell)
      if (corner >= record.vertices.size()) throw DecodeError("a cell of unknown vertices");
  }
  return record;
}

// Points by their bits: 0 and -0 differ, and so both survive.
using PointBits = std::array<std::uint64_t, 3>;
struct HashPointBits {
  std::size_t operator()(const PointBits& bits) const {
    std::uint64_t hash = 0;
    for (const std::uint64_t word : bits) hash = std::rotl((hash ^ word) * 0x9E3779B97F4A7C15u, 29);
    return hash;
  }
};

TriangleColumns stored_form(const LeafSurface& record) {
  TriangleColumns columns;
  Steps<std::uint64_t> ids;
  PositionWriter corners(columns.corners, record.triangles.size());
  std::unordered_map<PointBits, std::uint32_t, HashPointBits> index;  // looked up, never iterated
  for (const Triangle& triangle : record.triangles) {
    columns.ids.push_back(ids.to_step(triangle.id));
    for (const Point& corner : triangle.corners) {
      const auto num_known = static_cast<std::uint32_t>(index.size());
      const auto [known, is_new] = index.try_emplace(std::bit_cast<PointBits>(corner), num_known);
      if (is_new) corners.add(corner);
      columns.references.push_back(num_known - known->second);
    }
  }
  return columns;
}

LeafSurface record_of(const TriangleColumns& columns) {
  const std::vector<Point> corners = positions_of(columns.corners);
  check_length(columns.references.size(), 3 * columns.ids.size());
  LeafSurface record;
  record.triangles.resize(columns.ids.size());
  Steps<std::uint64_t> ids;
  std::uint32_t num_known = 0;
  for (std::size_t t = 0; t < record.triangles.size(); ++t) {
    record.triangles[t].id = ids.to_value(columns.ids[t]);
    for (std::size_t i = 0; i < 3; ++i) {
      const std::uint32_t reference = columns.references[3 * t + i];
      if (reference > num_known || (reference == 0 && num_known >= corners.size()))
        throw DecodeError("a triangle of unknown corners");
      record.triangles[t].corners[i] = corners[num_known - reference];
      if (reference == 0) ++num_known;
    }
  }
  check_length(num_known, corners.size());
  return record;
}

SiteColumns stored_form(const LeafUnresolved& record) {
  SiteColumns columns;
  PositionWriter positions(columns.positions, record.sites.size());
  ChangedBits radius;
  for (const UnresolvedSite& site : record.sites) {
    assert(1 <= site.condition && site.condition <= kNumConditions);
    columns.conditions.push_back(site.condition);
    positions.add(site.position);
    columns.radii.push_back(radius.to_change(site.radius));
  }
  return columns;
}

LeafUnresolved record_of(const SiteColumns& columns) {
  const std::vector<Point> positions = positions_of(columns.positions);
  check_length(columns.conditions.size(), positions.size());
  check_length(columns.radii.size(), positions.size());
  LeafUnresolved record;
  record.sites.reserve(positions.size());
  ChangedBits radius;
  for (std::size_t i = 0; i < positions.size(); ++i) {
    const std::uint8_t condition = columns.conditions[i];
    if (condition < 1 || condition > kNumConditions)
      throw DecodeError("a site of no known condition");
    record.sites.push_back({condition, positions[i], radius.to_value(columns.radii[i])});
  }
  return record;
}

SampleColumns stored_form(const TimelineRecord& record) {
  SampleColumns columns;
  std::array<Steps<std::uint64_t>, kNumSampleNumbers> steps;
  for (const TimelineSample& sample : record.samples) {
    const auto numbers = numbers_of(sample);
    for (std::size_t n = 0; n < kNumSampleNumbers; ++n)
      columns.numbers[n].push_back(steps[n].to_step(*numbers[n]));
    columns.phases.push_back(static_cast<std::uint8_t>(sample.phase));
  }
  return columns;
}

TimelineRecord record_of(const SampleColumns& columns) {
  for (const auto& column : columns.numbers) check_length(column.size(), columns.phases.size());
  TimelineRecord record;
  record.samples.resize(columns.phases.size());
  std::array<Steps<std::uint64_t>, kNumSampleNumbers> steps;
  for (std::size_t i = 0; i < record.samples.size(); ++i) {
    TimelineSample& sample = record.samples[i];
    const auto numbers = numbers_of(sample);
    for (std::size_t n = 0; n < kNumSampleNumbers; ++n)
      *numbers[n] = steps[n].to_value(columns.numbers[n][i]);
    sample.phase = static_cast<Phase>(columns.phases[i]);
    if (sample.phase > last_of(sample.phase)) throw DecodeError("a phase that there is not");
  }
  return record;
}

StoredLeafInfo stored_form(const LeafInfo& info) {
  return {info, info.queued.has_value(), info.queued.value_or(QueuePosition())};
}

LeafInfo record_of(StoredLeafInfo leaf) {
  if (leaf.is_queued)
    leaf.info.queued = leaf.position;
  else if (leaf.position != QueuePosition())
    throw DecodeError("a place in the queue of a leaf that is not queued");
  return leaf.info;
}

// The others are stored as they are.
template <class Record>
const Record& stored_form(const Record& record) {
  return record;
}
template <class Record>
Record record_of(Record record) {
  return record;
}

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
  out(kKind<Record>.number, kKind<Record>.version, leaf, stored_form(record));
  return compress(out.bytes());
}

template <class Record>
Record decode(std::string_view bytes, MortonKey leaf) try {
  const Content content = decompress(bytes);
  ContentReader in(content.view());
  std::uint8_t kind = 0;
  std::uint16_t version = 0;
  MortonKey stored_leaf;
  in(kind, version, stored_leaf);
  if (kind != kKind<Record>.number) throw DecodeError("a record of another kind");
  if (stored_leaf != leaf) throw DecodeError("a record of another leaf");
  if (version != kKind<Record>.version)
    throw DecodeError("record version " + std::to_string(version) +
                      ", which this program does not know");
  std::remove_cvref_t<decltype(stored_form(std::declval<Record>()))> stored;
  in(stored);
  if (!in.is_at_end()) throw DecodeError("bytes left over");
  return record_of(std::move(stored));
} catch (const boost::archive::archive_exception&) {
  throw DecodeError("a record cut short");
}

template std::string encode(const StoreFormat&, MortonKey);
template std::string encode(const RunRecord&, MortonKey);
template std::string encode(const LeafInfo&, MortonKey);
template std::string encode(const LeafPoints&, MortonKey);
template std::string encode(const LeafCells&, MortonKey);
template std::string encode(const LeafSurface&, MortonKey);
template std::string encode(const LeafUnresolved&, MortonKey);
template std::string encode(const QueueEntry&, MortonKey);
template std::string encode(const MemoryRecord&, MortonKey);
template std::string encode(const KeySums&, MortonKey);
template std::string encode(const TimelineRecord&, MortonKey);
template StoreFormat decode(std::string_view, MortonKey);
template RunRecord decode(std::string_view, MortonKey);
template LeafInfo decode(std::string_view, MortonKey);
template LeafPoints decode(std::string_view, MortonKey);
template LeafCells decode(std::string_view, MortonKey);
template LeafSurface decode(std::string_view, MortonKey);
template LeafUnresolved decode(std::string_view, MortonKey);
template QueueEntry decode(std::string_view, MortonKey);
template MemoryRecord decode(std::string_view, MortonKey);
template KeySums decode(std::string_view, MortonKey);
template TimelineRecord decode(std::string_view, MortonKey);

}  // namespace locvol
