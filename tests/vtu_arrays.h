// Reads arrays of a VTU file with raw appended data, by their names.
#pragma once

#include <cstdint>
#include <cstring>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <vector>

#include "tests/file_bytes.h"

namespace locvol {

class VtuArrays {
 public:
  explicit VtuArrays(const std::filesystem::path& file) {
    bytes_ = bytes_of(file);
    const std::string mark = "<AppendedData encoding=\"raw\">";
    data_ = bytes_.find('_', bytes_.find(mark) + mark.size()) + 1;
  }

  std::size_t num_points() const { return number("NumberOfPoints=\""); }
  std::size_t num_cells() const { return number("NumberOfCells=\""); }

  template <class T>
  std::vector<T> array(const std::string& type, const std::string& name) const {
    const std::size_t tag = bytes_.find("<DataArray type=\"" + type + "\" Name=\"" + name + "\"");
    if (tag == std::string::npos) throw std::runtime_error("no array " + name);
    const std::size_t place = data_ + number("offset=\"", tag);
    std::uint64_t num_bytes = 0;
    std::memcpy(&num_bytes, &bytes_.at(place), sizeof num_bytes);
    if (place + sizeof num_bytes + num_bytes > bytes_.size()) throw std::runtime_error("cut short");
    std::vector<T> values(num_bytes / sizeof(T));
    if (num_bytes > 0) std::memcpy(values.data(), &bytes_.at(place + sizeof num_bytes), num_bytes);
    return values;
  }

 private:
  std::size_t number(const std::string& before, std::size_t from = 0) const {
    return std::stoull(bytes_.substr(bytes_.find(before, from) + before.size(), 24));
  }

  std::string bytes_;
  std::size_t data_ = 0;
};

}  // namespace locvol
