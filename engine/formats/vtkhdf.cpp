#include <hdf5.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cerrno>
#include <cstring>
#include <functional>
#include <mutex>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "engine/exchange/in_rank_order.h"
#include "engine/formats/deflate.h"
#include "engine/formats/formats.h"
#include "engine/formats/mesh_arrays.h"
#include "engine/formats/outputs.h"

namespace locvol {
namespace {

constexpr std::uint64_t kChunkBytes = std::uint64_t{1} << 20;
constexpr unsigned kDeflateLevel = 1;  // for the record: chunks come compressed

// A turn at the library, which knows no threads. Errors are thrown, so it need not print them.
class HdfTurn {
 public:
  HdfTurn() : lock_(mutex_) {
    // The first call of all: at exit, HDF5 would try to write what a full disk refused, and crash.
    H5dont_atexit();
    H5Eget_auto2(H5E_DEFAULT, &function_, &data_);
    H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
  }
  ~HdfTurn() { H5Eset_auto2(H5E_DEFAULT, function_, data_); }
  HdfTurn(const HdfTurn&) = delete;
  HdfTurn& operator=(const HdfTurn&) = delete;

 private:
  static inline std::mutex mutex_;
  std::lock_guard<std::mutex> lock_;
  H5E_auto2_t function_ = nullptr;
  void* data_ = nullptr;
};

// An HDF5 file under construction. Times are not noted, so that bytes depend on the mesh alone.
class HdfFile {
 public:
  explicit HdfFile(const std::filesystem::path& name) : name_(name) {
    const Id access = own(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
    check(H5Pset_file_locking(access.get(), false, true));
    file_ = own(H5Fcreate(name.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, access.get()), H5Fclose);
  }

  // An identifier, closed with its owner.
  class Id {
   public:
    Id() = default;
    Id(hid_t id, herr_t (*close_it)(hid_t)) : id_(id), close_(close_it) {}
    Id(Id&& other) noexcept : id_(std::exchange(other.id_, -1)), close_(other.close_) {}
    Id& operator=(Id&& other) noexcept {
      std::swap(id_, other.id_);
      std::swap(close_, other.close_);
      return *this;
    }
    ~Id() {
      if (id_ >= 0) close_(id_);
    }
    hid_t get() const { return id_; }
    hid_t release() { return std::exchange(id_, -1); }

   private:
    hid_t id_ = -1;
    herr_t (*close_)(hid_t) = nullptr;
  };

  Id own(hid_t id, herr_t (*close_it)(hid_t)) const {
    check(id);
    return {id, close_it};
  }
  void check(std::int64_t result) const {
    if (result >= 0) return;
    const std::string what = "cannot write " + name_.string();
    if (errno != 0) throw std::system_error(errno, std::generic_category(), what);
    throw std::runtime_error(what + ": HDF5 reports an error");
  }

  // Names are paths.
  Id group(const char* name) const {
    const Id properties = own(H5Pcreate(H5P_GROUP_CREATE), H5Pclose);
    check(H5Pset_obj_track_times(properties.get(), false));
    return own(H5Gcreate2(id(), name, H5P_DEFAULT, properties.get(), H5P_DEFAULT), H5Gclose);
  }
  void attribute(hid_t object, const char* name, hid_t type, hid_t space, const void* value) const {
    const Id created =
        own(H5Acreate2(object, name, type, space, H5P_DEFAULT, H5P_DEFAULT), H5Aclose);
    check(H5Awrite(created.get(), type, value));
  }
  Id dataset(const std::string& name, hid_t type, hid_t space, const Id& properties) const {
    return own(
        H5Dcreate2(id(), name.c_str(), type, space, H5P_DEFAULT, properties.get(), H5P_DEFAULT),
        H5Dclose);
  }
  // A dataset of rank 1.
  void numbers(const std::string& name, const std::vector<std::uint64_t>& values) const {
    const hsize_t length = values.size();
    const Id space = own(H5Screate_simple(1, &length, nullptr), H5Sclose);
    const Id dataset = this->dataset(name, H5T_STD_I64LE, space.get(), properties());
    check(H5Dwrite(dataset.get(), H5T_NATIVE_UINT64, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()));
  }
  Id properties() const {
    Id created = own(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
    check(H5Pset_obj_track_times(created.get(), false));
    return created;
  }
  hid_t id() const { return file_.get(); }
  void close() { check(H5Fclose(file_.release())); }

 private:
  std::filesystem::path name_;
  Id file_;
};

hid_t type_of(std::string_view vtk_type) {
  if (vtk_type == "Float64") return H5T_IEEE_F64LE;
  if (vtk_type == "Float32") return H5T_IEEE_F32LE;
  if (vtk_type == "Int64") return H5T_STD_I64LE;
  if (vtk_type == "UInt32") return H5T_STD_U32LE;
  return H5T_STD_U8LE;
}

// VTK's name of the array in this format.
std::string_view hdf_name(const ArrayInfo& info) {
  switch (info.array) {
    case ArrayName::kConnectivity:
      return "Connectivity";
    case ArrayName::kStarts:
      return "Offsets";
    case ArrayName::kTypes:
      return "Types";
    default:
      return info.name;
  }
}

std::string path_of(const ArrayInfo& info) {
  std::string path = "VTKHDF/";
  if (info.is_cell_data) path += "CellData/";
  if (info.array == ArrayName::kPointIds || info.array == ArrayName::kCorner) path += "PointData/";
  return path.append(hdf_name(info));
}

// Of rank 2 if items are rows of several values.
struct Extent {
  explicit Extent(const ArrayInfo& info)
      : rank(info.num_components > 1 ? 2 : 1), size{info.num_items, info.num_components} {}
  int rank;
  std::array<hsize_t, 2> size;
};

HdfFile::Id space_of(const HdfFile& hdf, const Extent& extent) {
  return hdf.own(H5Screate_simple(extent.rank, extent.size.data(), nullptr), H5Sclose);
}

std::uint64_t items_of_chunk(const ArrayInfo& info) {
  return std::min(kChunkBytes / std::bit_ceil(info.item_bytes()), info.num_items);
}

// The last one is filled up.
std::vector<std::byte> compressed_chunk(const ArrayInfo& info, std::span<const std::byte> bytes) {
  const std::uint64_t chunk_bytes = items_of_chunk(info) * info.item_bytes();
  if (bytes.size() == chunk_bytes) return deflated(shuffled(bytes, info.value_bytes));
  std::vector<std::byte> whole(bytes.begin(), bytes.end());
  whole.resize(chunk_bytes);
  return deflated(shuffled(whole, info.value_bytes));
}

// The rank's chunks of each run of an array, in order, compressed by the threads; then, on the
// first rank, those of the others, which wait in nameless files beside the output until it has its
// own.
void for_each_chunk(const ArrayInfo& info, ArrayBlocks& arrays, Exchange& exchange,
                    const std::filesystem::path& output,
                    const std::function<void(std::span<const std::byte>)>& take) {
  const bool is_first = exchange.rank() == 0;
  for (const auto& blocks : arrays.blocks(info, items_of_chunk(info))) {
    std::optional<OpenFile> waiting;
    std::vector<std::uint64_t> ends = {0};
    do_on_all(exchange, [&] {
      if (!is_first) waiting.emplace(OpenFile::temporary(output));
      arrays.for_each(
          blocks, [&](std::span<const std::byte> bytes) { return compressed_chunk(info, bytes); },
          [&](const std::vector<std::byte>& chunk) {
            if (is_first) return take(chunk);
            waiting->write_at(ends.back(), chunk);
            ends.push_back(ends.back() + chunk.size());
          });
    });
    std::size_t i = 0;
    const auto next_waiting = [&]() -> std::optional<std::string> {
      if (i + 1 == ends.size()) return std::nullopt;
      std::string chunk(ends[i + 1] - ends[i], '\0');
      waiting->read_at(ends[i++], std::as_writable_bytes(std::span(chunk)));
      return chunk;
    };
    tell_first_rank(exchange, next_waiting,
                    [&](const std::string& chunk) { take(std::as_bytes(std::span(chunk))); });
  }
}

void write_array(const HdfFile& hdf, const ArrayInfo& info, ArrayBlocks& blocks, Exchange& exchange,
                 const std::filesystem::path& output) {
  const std::uint64_t chunk_items = items_of_chunk(info);
  const Extent extent(info);
  const std::array<hsize_t, 2> chunk = {chunk_items, info.num_components};
  const auto space = space_of(hdf, extent);
  const auto properties = hdf.properties();
  if (chunk_items > 0) {
    hdf.check(H5Pset_chunk(properties.get(), extent.rank, chunk.data()));
    hdf.check(H5Pset_fill_time(properties.get(), H5D_FILL_TIME_NEVER));
    hdf.check(H5Pset_shuffle(properties.get()));
    hdf.check(H5Pset_deflate(properties.get(), kDeflateLevel));
  }
  const auto dataset = hdf.dataset(path_of(info), type_of(info.vtk_type), space.get(), properties);
  std::array<hsize_t, 2> place = {0, 0};
  for_each_chunk(info, blocks, exchange, output, [&](std::span<const std::byte> bytes) {
    hdf.check(
        H5Dwrite_chunk(dataset.get(), H5P_DEFAULT, 0, place.data(), bytes.size(), bytes.data()));
    place[0] += chunk[0];
  });
}

void add_version_and_type(const HdfFile& hdf, hid_t group) {
  const hsize_t length = 2;
  const std::array<std::int64_t, 2> version = {1, 0};
  const auto pair = hdf.own(H5Screate_simple(1, &length, nullptr), H5Sclose);
  hdf.attribute(group, "Version", H5T_NATIVE_INT64, pair.get(), version.data());
  constexpr std::string_view kType = "UnstructuredGrid";
  const auto text = hdf.own(H5Tcopy(H5T_C_S1), H5Tclose);
  hdf.check(H5Tset_size(text.get(), kType.size()));
  hdf.check(H5Tset_strpad(text.get(), H5T_STR_NULLPAD));
  const auto scalar = hdf.own(H5Screate(H5S_SCALAR), H5Sclose);
  hdf.attribute(group, "Type", text.get(), scalar.get(), kType.data());
}

// All but the arrays.
void write_head(const HdfFile& hdf, std::span<const PieceFile> partitions,
                const std::vector<VtuField>& fields, bool is_part) {
  std::vector<std::uint64_t> num_vertices, num_cells, num_corners;
  for (const PieceFile& partition : partitions) {
    const CellKinds kinds = cell_kinds(partition.counts);
    num_vertices.push_back(partition.counts.num_vertices);
    num_cells.push_back(locvol::num_cells(kinds));
    num_corners.push_back(corners_before(num_cells.back(), kinds));
  }
  add_version_and_type(hdf, hdf.group("VTKHDF").get());
  hdf.numbers("VTKHDF/NumberOfPoints", num_vertices);
  hdf.numbers("VTKHDF/NumberOfCells", num_cells);
  hdf.numbers("VTKHDF/NumberOfConnectivityIds", num_corners);
  hdf.group("VTKHDF/CellData");
  if (is_part || partitions.front().counts.has_creases) hdf.group("VTKHDF/PointData");
  if (fields.empty()) return;
  hdf.group("VTKHDF/FieldData");
  for (const VtuField& field : fields)
    hdf.numbers("VTKHDF/FieldData/" + field.name, {field.id, field.dimension});
}

std::vector<ArrayInfo> hdf_arrays(const PieceFile& partition, const OutputOptions& output,
                                  bool is_part) {
  std::vector<ArrayInfo> arrays = mesh_arrays(partition.counts, output, {8, 8}, is_part);
  const auto ends = std::ranges::find(arrays, ArrayName::kEnds, &ArrayInfo::array);
  ends->array = ArrayName::kStarts;
  ++ends->num_items;
  return arrays;
}

// The array of each piece's file, one after another.
void write_virtual_array(const HdfFile& hdf, std::span<const PieceFile> pieces,
                         const std::function<ArrayInfo(const PieceFile&)>& array_of) {
  ArrayInfo all = array_of(pieces.front());
  for (const PieceFile& piece : pieces.subspan(1)) all.num_items += array_of(piece).num_items;
  const auto space = space_of(hdf, Extent(all));
  const auto properties = hdf.properties();
  std::array<hsize_t, 2> place = {0, 0};
  for (const PieceFile& piece : pieces) {
    const Extent extent(array_of(piece));
    if (extent.size[0] == 0) continue;
    hdf.check(H5Sselect_hyperslab(space.get(), H5S_SELECT_SET, place.data(), nullptr,
                                  extent.size.data(), nullptr));
    hdf.check(H5Pset_virtual(properties.get(), space.get(), piece.name.c_str(),
                             path_of(all).c_str(), space_of(hdf, extent).get()));
    place[0] += extent.size[0];
  }
  hdf.dataset(path_of(all), type_of(all.vtk_type), space.get(), properties);
}

}  // namespace

std::uint64_t write_vtkhdf(MeshSource& mesh, const OutputOptions& output, PartialFile& file) {
  const PieceFile whole{file.name().string(), counts_of(mesh, output)};
  const bool is_part = mesh.part().has_value();
  const std::vector<ArrayInfo> arrays = hdf_arrays(whole, output, is_part);
  Exchange& exchange = mesh.exchange();
  ArrayBlocks blocks(mesh, output, file.name());
  if (!mesh.is_of_first_rank()) {
    for (const ArrayInfo& info : arrays) for_each_chunk(info, blocks, exchange, file.name(), {});
    return 0;
  }
  const HdfTurn turn;
  errno = 0;
  HdfFile hdf(file.partial_name());
  write_head(hdf, {&whole, 1}, name_fields(mesh, output, "/"), is_part);
  for (const ArrayInfo& info : arrays) write_array(hdf, info, blocks, exchange, file.name());
  hdf.close();
  return std::filesystem::file_size(file.partial_name());
}

void write_partitioned_vtkhdf(std::span<const PieceFile> pieces, const OutputOptions& output,
                              const std::vector<VtuField>& fields, PartialFile& file) {
  const HdfTurn turn;
  errno = 0;
  HdfFile hdf(file.partial_name());
  write_head(hdf, pieces, fields, true);
  const std::size_t num_arrays = hdf_arrays(pieces.front(), output, true).size();
  for (std::size_t i = 0; i < num_arrays; ++i)
    write_virtual_array(hdf, pieces,
                        [&](const PieceFile& piece) { return hdf_arrays(piece, output, true)[i]; });
  hdf.close();
}

}  // namespace locvol
