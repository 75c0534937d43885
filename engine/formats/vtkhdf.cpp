#include <hdf5.h>

#include <array>
#include <bit>
#include <cerrno>
#include <cstring>
#include <stdexcept>
#include <string>
#include <system_error>
#include <utility>

#include "engine/formats/deflate.h"
#include "engine/formats/formats.h"
#include "engine/formats/mesh_arrays.h"

namespace locvol {
namespace {

constexpr std::uint64_t kChunkBytes = std::uint64_t{1} << 20;
constexpr unsigned kDeflateLevel = 1;  // for the record: chunks come compressed

// Errors are thrown, so the library need not print them.
class SilentErrors {
 public:
  SilentErrors() {
    // The first call of all: at exit, HDF5 would try to write what a full disk refused, and crash.
    H5dont_atexit();
    H5Eget_auto2(H5E_DEFAULT, &function_, &data_);
    H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
  }
  ~SilentErrors() { H5Eset_auto2(H5E_DEFAULT, function_, data_); }
  SilentErrors(const SilentErrors&) = delete;
  SilentErrors& operator=(const SilentErrors&) = delete;

 private:
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

  Id group(hid_t parent, const char* name) const {
    const Id properties = own(H5Pcreate(H5P_GROUP_CREATE), H5Pclose);
    check(H5Pset_obj_track_times(properties.get(), false));
    return own(H5Gcreate2(parent, name, H5P_DEFAULT, properties.get(), H5P_DEFAULT), H5Gclose);
  }
  void attribute(hid_t object, const char* name, hid_t type, hid_t space, const void* value) const {
    const Id created =
        own(H5Acreate2(object, name, type, space, H5P_DEFAULT, H5P_DEFAULT), H5Aclose);
    check(H5Awrite(created.get(), type, value));
  }
  // One value in a dataset of rank 1.
  void number(hid_t parent, const char* name, std::uint64_t value) const {
    const hsize_t length = 1;
    const Id space = own(H5Screate_simple(1, &length, nullptr), H5Sclose);
    const Id dataset = own(H5Dcreate2(parent, name, H5T_STD_I64LE, space.get(), H5P_DEFAULT,
                                      properties().get(), H5P_DEFAULT),
                           H5Dclose);
    check(H5Dwrite(dataset.get(), H5T_NATIVE_UINT64, H5S_ALL, H5S_ALL, H5P_DEFAULT, &value));
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

// Of rank 2 if items are rows of values and stay so; the connectivity is a list. Chunks are
// compressed by the threads, and HDF5 only puts them into their places.
void write_array(const HdfFile& hdf, hid_t parent, const char* name, const ArrayInfo& info,
                 ArrayBlocks& blocks) {
  const bool has_rows = info.array == ArrayName::kPoints;
  const std::uint64_t values_per_item = has_rows ? 1 : info.num_components;
  const std::uint64_t most_items = kChunkBytes / std::bit_ceil(info.item_bytes());
  const std::uint64_t chunk_items = std::min(most_items, info.num_items);
  const int rank = has_rows ? 2 : 1;
  const std::array<hsize_t, 2> size = {info.num_items * values_per_item, info.num_components};
  const std::array<hsize_t, 2> chunk = {chunk_items * values_per_item, info.num_components};
  const auto space = hdf.own(H5Screate_simple(rank, size.data(), nullptr), H5Sclose);
  const auto properties = hdf.properties();
  if (chunk_items > 0) {
    hdf.check(H5Pset_chunk(properties.get(), rank, chunk.data()));
    hdf.check(H5Pset_fill_time(properties.get(), H5D_FILL_TIME_NEVER));
    hdf.check(H5Pset_shuffle(properties.get()));
    hdf.check(H5Pset_deflate(properties.get(), kDeflateLevel));
  }
  const auto dataset = hdf.own(H5Dcreate2(parent, name, type_of(info.vtk_type), space.get(),
                                          H5P_DEFAULT, properties.get(), H5P_DEFAULT),
                               H5Dclose);
  std::array<hsize_t, 2> place = {0, 0};
  blocks.for_each_block(
      info, chunk_items,
      [&](std::span<const std::byte> bytes) {
        const std::uint64_t chunk_bytes = chunk_items * info.item_bytes();
        if (bytes.size() == chunk_bytes) return deflated(shuffled(bytes, info.value_bytes));
        std::vector<std::byte> whole(bytes.begin(), bytes.end());
        whole.resize(chunk_bytes);
        return deflated(shuffled(whole, info.value_bytes));
      },
      [&](const std::vector<std::byte>& bytes) {
        hdf.check(H5Dwrite_chunk(dataset.get(), H5P_DEFAULT, 0, place.data(), bytes.size(),
                                 bytes.data()));
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

// VTK's name of the array in this format.
const char* hdf_name(const ArrayInfo& info) {
  switch (info.array) {
    case ArrayName::kConnectivity:
      return "Connectivity";
    case ArrayName::kStarts:
      return "Offsets";
    case ArrayName::kTypes:
      return "Types";
    default:
      return info.name.data();
  }
}

}  // namespace

std::uint64_t write_vtkhdf(MeshSource& mesh, bool has_quality, PartialFile& file) {
  const SilentErrors silent;
  ArrayBlocks blocks(mesh, has_quality, file.name());
  errno = 0;
  HdfFile hdf(file.partial_name());
  {
    const auto root = hdf.group(hdf.id(), "VTKHDF");
    add_version_and_type(hdf, root.get());
    hdf.number(root.get(), "NumberOfPoints", mesh.num_vertices());
    hdf.number(root.get(), "NumberOfCells", mesh.num_cells());
    hdf.number(root.get(), "NumberOfConnectivityIds", 4 * mesh.num_cells());
    const auto cell_data = hdf.group(root.get(), "CellData");
    for (ArrayInfo info : mesh_arrays(mesh.num_vertices(), mesh.num_cells(), has_quality, {8, 8})) {
      if (info.array == ArrayName::kEnds) {
        info.array = ArrayName::kStarts;
        ++info.num_items;
      }
      write_array(hdf, info.is_cell_data ? cell_data.get() : root.get(), hdf_name(info), info,
                  blocks);
    }
  }
  hdf.close();
  return std::filesystem::file_size(file.partial_name());
}

}  // namespace locvol
