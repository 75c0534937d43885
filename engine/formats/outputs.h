// How the formats put bytes into a file: one after another, or at known places.
#pragma once

#include <array>
#include <charconv>
#include <cstdint>
#include <functional>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>

#include "engine/exchange/exchange.h"
#include "engine/output/mesh_source.h"
#include "engine/shared/encode_in_order.h"
#include "engine/shared/partial_file.h"

namespace locvol {

// Bytes as they come. By several ranks, which all make the same calls: what is the same on all is
// written by the first one, and of a run, what each has comes after that of lower ranks.
class AppendedFile {
 public:
  AppendedFile(PartialFile& file, Exchange& exchange, std::uint64_t offset = 0)
      : file_(file), exchange_(exchange), offset_(offset) {}
  void append(std::span<const std::byte> bytes) {
    if (exchange_.rank() == 0) file_.write_at(offset_, bytes);
    offset_ += bytes.size();
  }
  void append(std::string_view text) { append(std::as_bytes(std::span(text))); }

  // Takes what a piece was encoded into.
  struct Append {
    std::function<void(std::span<const std::byte>)> put;
    template <class Encoded>
    void operator()(const Encoded& encoded) const {
      put(encoded.bytes());
    }
  };
  // What write(append) appends, talking to no other rank. `num_bytes`: the rank's own, if they are
  // known; else what others than the first write waits in a nameless file beside the output.
  using Write = std::function<void(const Append&)>;
  void append_run(const Write& write, std::optional<std::uint64_t> num_bytes = std::nullopt);
  std::uint64_t size() const { return offset_; }

 private:
  void append_here(const Write& write);

  PartialFile& file_;
  Exchange& exchange_;
  std::uint64_t offset_;
};

// Appends what `encode` makes of each piece, as a run; `num_bytes`: see AppendedFile::append_run().
template <class Encode>
void append_pieces(AppendedFile& out, MeshSource& mesh, const PieceParts& parts,
                   const Encode& encode, std::optional<std::uint64_t> num_bytes = std::nullopt) {
  out.append_run([&](const auto& append) { mesh.for_each_piece(parts, encode, append); },
                 num_bytes);
}
// Appends what `encode` makes of what next() gives of the boundary, as append_pieces() does.
template <class Next, class Encode>
void append_boundary(AppendedFile& out, MeshSource& mesh, const Next& next, const Encode& encode,
                     std::optional<std::uint64_t> num_bytes = std::nullopt) {
  out.append_run([&](const auto& append) { encode_in_order(mesh.workers(), next, encode, append); },
                 num_bytes);
}

// Threads: any may write; one at a time does, for the kernel lets no more, and others would spin.
class PlacedFile {
 public:
  explicit PlacedFile(PartialFile& file) : file_(file) {}
  struct Part {
    std::uint64_t offset;
    std::span<const std::byte> bytes;
  };
  void write(std::span<const Part> parts) {
    const std::lock_guard lock(mutex_);
    for (const auto& [offset, bytes] : parts) file_.write_at(offset, bytes);
  }

 private:
  PartialFile& file_;
  std::mutex mutex_;
};

// Little-endian values, one after another.
class Bytes {
 public:
  template <class T>
  Bytes& add(const T& value) {
    static_assert(std::is_trivially_copyable_v<T>);
    bytes_.append(reinterpret_cast<const char*>(&value), sizeof value);
    return *this;
  }
  Bytes& add_text(std::string_view text) {
    bytes_ += text;
    return *this;
  }
  void reserve(std::size_t num_bytes) { bytes_.reserve(num_bytes); }
  std::span<const std::byte> bytes() const { return std::as_bytes(std::span(bytes_)); }
  std::size_t size() const { return bytes_.size(); }

 private:
  std::string bytes_;
};

// A line of text from numbers: reals as the shortest that read back the same.
class Text {
 public:
  Text& add(double value) { return convert(value); }
  Text& add(std::uint64_t value) { return convert(value); }
  Text& add(char c) {
    text_ += c;
    return *this;
  }
  Text& add(std::string_view text) {
    text_ += text;
    return *this;
  }
  void reserve(std::size_t num_bytes) { text_.reserve(num_bytes); }
  const std::string& text() const { return text_; }
  std::span<const std::byte> bytes() const { return std::as_bytes(std::span(text_)); }

 private:
  template <class Number>
  Text& convert(Number value) {
    std::array<char, 32> digits;
    const auto [end, error] = std::to_chars(digits.data(), digits.data() + digits.size(), value);
    text_.append(digits.data(), static_cast<std::size_t>(end - digits.data()));
    return *this;
  }
  std::string text_;
};

}  // namespace locvol
