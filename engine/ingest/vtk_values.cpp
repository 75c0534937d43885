#include "engine/ingest/vtk_values.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <utility>
#include <vector>

#include "engine/formats/deflate.h"
#include "engine/ingest/text_scanner.h"

namespace locvol {
namespace {

constexpr std::size_t kViewBytes = std::size_t{1} << 16;  // of the file, looked at at once
constexpr std::size_t kMostWordBytes = 400;  // of a number as text: DBL_MIN has 308 zeros
constexpr std::uint64_t kMostBlocks = std::uint64_t{1} << 24;
constexpr std::uint64_t kMostBlockBytes = std::uint64_t{1} << 26;

constexpr std::array<std::string_view, 10> kTypeNames = {
    "Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64", "Float32", "Float64"};

constexpr bool is_blank(int c) { return c == ' ' || c == '\t' || c == '\r' || c == '\n'; }

[[noreturn]] void refuse(const InputFile& file, const VtkArray& array, const std::string& what) {
  file.refuse(fmt::format("array \"{}\": {}", shown(array.name), what));
}

[[noreturn]] void refuse_more(const InputFile& file, const VtkArray& array) {
  refuse(file, array,
         fmt::format("it goes on after the {} values that {} has; correct that, or export the file "
                     "again",
                     array.num_values, array.counted_by));
}

// ---- Characters

constexpr int kNoCharacter = -1;

// Of a file, one after the other: InputFile is for larger pieces.
class Characters {
 public:
  explicit Characters(InputFile& file) : file_(file) {}

  std::uint64_t position() const { return file_.position() + begin_; }
  int peek() {  // kNoCharacter at the end of the file
    if (begin_ == view_.size() && !look_on()) return kNoCharacter;
    return static_cast<unsigned char>(view_[begin_]);
  }
  void take() { ++begin_; }
  int peek_after_blanks() {
    while (is_blank(peek())) take();
    return peek();
  }

 private:
  bool look_on() {
    file_.take(begin_);
    view_ = file_.peek(kViewBytes);
    begin_ = 0;
    return !view_.empty();
  }

  InputFile& file_;
  std::string_view view_;  // of what is not taken from the file
  std::size_t begin_ = 0;
};

class TextValues : public VtkValues {
 public:
  TextValues(InputFile& file, const VtkArray& array)
      : file_(file), array_(array), characters_(file) {}

  void read(std::span<double> values) override {
    for (double& value : values) value = next();
  }
  void check_end() override {
    if (const int c = characters_.peek_after_blanks(); c == kNoCharacter) file_.refuse_truncated();
    if (characters_.peek() != '<') refuse_more(file_, array_);
  }

 private:
  double next() {
    const int first = characters_.peek_after_blanks();
    if (first == kNoCharacter) file_.refuse_truncated();
    if (first == '<')
      refuse(file_, array_,
             fmt::format("it ends after {} values, but {} has {}; correct that, or export the file "
                         "again",
                         num_read_, array_.counted_by, array_.num_values));
    word_.clear();
    for (int c = first; c != kNoCharacter && c != '<' && !is_blank(c); c = characters_.peek()) {
      word_ += static_cast<char>(c);
      characters_.take();
      if (word_.size() > kMostWordBytes) break;
    }
    const std::optional<double> value = parse_number(word_);
    if (!value)
      refuse(file_, array_,
             fmt::format("its value {} (counted from 0) is \"{}\", which is no number (with a "
                         "decimal point); correct it",
                         num_read_, shown(word_)));
    ++num_read_;
    return *value;
  }

  InputFile& file_;
  VtkArray array_;
  Characters characters_;
  std::string word_;
  std::uint64_t num_read_ = 0;
};

// ---- Bytes

class ByteSource {
 public:
  virtual ~ByteSource() = default;
  virtual void read(std::span<std::byte> bytes) = 0;
  virtual void check_end() = 0;
};

class RawBytes : public ByteSource {
 public:
  explicit RawBytes(InputFile& file) : file_(file) {}

  void read(std::span<std::byte> bytes) override {
    while (!bytes.empty()) {
      const std::size_t n = std::min(bytes.size(), kViewBytes);
      std::memcpy(bytes.data(), file_.take(n), n);
      bytes = bytes.subspan(n);
    }
  }
  void check_end() override {}  // which nothing marks

 private:
  InputFile& file_;
};

constexpr std::array<std::int8_t, 256> kDigits = [] {
  std::array<std::int8_t, 256> digits{};
  digits.fill(-1);
  std::int8_t value = 0;
  for (const char c : std::string_view("ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz"
                                       "0123456789+/"))
    digits[static_cast<unsigned char>(c)] = value++;
  return digits;
}();

// Base64, of which several pieces may follow each other, each with its padding.
class DecodedBytes : public ByteSource {
 public:
  DecodedBytes(InputFile& file, const VtkArray& array)
      : file_(file), array_(array), characters_(file) {}

  void read(std::span<std::byte> bytes) override {
    for (std::byte& byte : bytes) {
      if (next_ == num_bytes_) decode_group();
      byte = group_[next_++];
    }
  }
  void check_end() override {
    if (next_ != num_bytes_) refuse_more(file_, array_);
    if (!array_.is_inline) return;
    if (const int c = characters_.peek_after_blanks(); c == kNoCharacter) file_.refuse_truncated();
    if (characters_.peek() != '<') refuse_more(file_, array_);
  }

 private:
  void decode_group() {
    std::uint32_t bits = 0;
    std::size_t num_pads = 0;
    for (int i = 0; i < 4; ++i) {
      const int c = characters_.peek_after_blanks();
      if (c == kNoCharacter) file_.refuse_truncated();
      const bool is_pad = c == '=' && i >= 2;
      const int digit = is_pad ? 0 : kDigits[static_cast<std::size_t>(c)];
      if (digit < 0 || (num_pads > 0 && !is_pad)) refuse_character(c);
      characters_.take();
      bits = bits << 6 | static_cast<std::uint32_t>(digit);
      num_pads += is_pad;
    }
    group_ = {std::byte(bits >> 16), std::byte(bits >> 8 & 0xff), std::byte(bits & 0xff)};
    num_bytes_ = 3 - num_pads;
    next_ = 0;
  }

  [[noreturn]] void refuse_character(int c) const {
    const std::uint64_t place = characters_.position();
    if (c == '<')
      refuse(
          file_, array_,
          fmt::format("its base64 ends too early, at byte {}: fewer values than {} has; export the "
                      "file again",
                      place, array_.counted_by));
    const char character = static_cast<char>(c);
    refuse(file_, array_,
           fmt::format("byte {} is '{}', which base64 does not have there; the file is damaged: "
                       "fetch or export it again",
                       place, shown({&character, 1})));
  }

  InputFile& file_;
  VtkArray array_;
  Characters characters_;
  std::array<std::byte, 3> group_{};
  std::size_t next_ = 0, num_bytes_ = 0;  // of the group
};

std::uint64_t read_word(ByteSource& source, const VtkArray& array) {
  std::array<std::byte, 8> bytes{};
  const std::size_t num_bytes = array.has_wide_head ? 8 : 4;
  source.read(std::span(bytes).first(num_bytes));
  return bits_in(bytes.data(), num_bytes, array.is_big_endian);
}

void check_length(const InputFile& file, const VtkArray& array, std::uint64_t num_bytes) {
  const std::uint64_t needed = array.num_values * bytes_of(array.type);
  if (num_bytes != needed)
    refuse(file, array,
           fmt::format("its head says {} bytes, but {} needs {} ({} values of {}); correct that, "
                       "header_type or byte_order, or export the file again",
                       num_bytes, array.counted_by, needed, array.num_values,
                       kTypeNames[static_cast<std::size_t>(array.type)]));
}

// Decompresses the blocks of zlib.
class InflatedBytes : public ByteSource {
 public:
  InflatedBytes(InputFile& file, const VtkArray& array, std::unique_ptr<ByteSource> source)
      : file_(file), array_(array), source_(std::move(source)) {
    read_head();
  }

  void read(std::span<std::byte> bytes) override {
    while (!bytes.empty()) {
      if (begin_ == block_.size()) inflate_block();
      const std::size_t n = std::min(bytes.size(), block_.size() - begin_);
      std::memcpy(bytes.data(), block_.data() + begin_, n);
      begin_ += n;
      bytes = bytes.subspan(n);
    }
  }
  void check_end() override { source_->check_end(); }

 private:
  void read_head() {
    const std::uint64_t num_blocks = read_word(*source_, array_);
    const std::uint64_t usual_bytes = read_word(*source_, array_);
    const std::uint64_t last_bytes = read_word(*source_, array_);
    last_bytes_ = last_bytes > 0 ? last_bytes : usual_bytes;
    block_bytes_ = num_blocks > 1 ? usual_bytes : last_bytes_;
    const std::size_t word_bytes = array_.has_wide_head ? 8 : 4;
    if (num_blocks == 0 || block_bytes_ == 0 || last_bytes_ > block_bytes_ ||
        num_blocks > file_.remaining() / word_bytes + 1)
      refuse_head(fmt::format("{} blocks of {} bytes, the last of {}", num_blocks, usual_bytes,
                              last_bytes));
    if (num_blocks > kMostBlocks || block_bytes_ > kMostBlockBytes)
      refuse(file_, array_,
             fmt::format("it has {} blocks of up to {} bytes, but {} of {} can be read; save it "
                         "with blocks of another size or without compression",
                         num_blocks, block_bytes_, kMostBlocks, kMostBlockBytes));
    check_length(file_, array_, (num_blocks - 1) * block_bytes_ + last_bytes_);
    for (std::uint64_t b = 0; b < num_blocks; ++b) compressed_bytes_.push_back(compressed_bytes(b));
  }

  std::uint32_t compressed_bytes(std::uint64_t block) {
    const std::uint64_t bytes = read_word(*source_, array_);
    if (bytes == 0 || bytes > block_bytes_ + block_bytes_ / 8 + 1024)
      refuse_head(
          fmt::format("{} compressed bytes of the {} of block {}", bytes, block_bytes_, block));
    return static_cast<std::uint32_t>(bytes);
  }

  [[noreturn]] void refuse_head(const std::string& what) const {
    refuse(file_, array_,
           fmt::format("its head says {}, which cannot be: it is damaged, or header_type or "
                       "byte_order are wrong; export the file again",
                       what));
  }

  void inflate_block() {
    compressed_.resize(compressed_bytes_[num_inflated_]);
    source_->read(compressed_);
    block_.resize(num_inflated_ + 1 < compressed_bytes_.size() ? block_bytes_ : last_bytes_);
    if (!inflate(compressed_, block_))
      refuse(file_, array_,
             fmt::format("its block {} of {} (counted from 0) cannot be decompressed; the file is "
                         "damaged: fetch or export it again",
                         num_inflated_, compressed_bytes_.size()));
    begin_ = 0;
    ++num_inflated_;
  }

  InputFile& file_;
  VtkArray array_;
  std::unique_ptr<ByteSource> source_;
  std::uint64_t block_bytes_ = 0, last_bytes_ = 0;
  std::vector<std::uint32_t> compressed_bytes_;  // by block
  std::vector<std::byte> compressed_, block_;
  std::size_t begin_ = 0;  // in the block
  std::size_t num_inflated_ = 0;
};

class ByteValues : public VtkValues {
 public:
  ByteValues(const VtkArray& array, std::unique_ptr<ByteSource> source)
      : array_(array), source_(std::move(source)) {}

  void read(std::span<double> values) override {
    const std::size_t value_bytes = bytes_of(array_.type);
    while (!values.empty()) {
      const std::size_t n = std::min(values.size(), buffer_.size() / value_bytes);
      source_->read(std::span(buffer_).first(n * value_bytes));
      for (std::size_t i = 0; i < n; ++i)
        values[i] = number_in(buffer_.data() + i * value_bytes, array_.type, array_.is_big_endian);
      values = values.subspan(n);
    }
  }
  void check_end() override { source_->check_end(); }

 private:
  VtkArray array_;
  std::unique_ptr<ByteSource> source_;
  std::array<std::byte, 1 << 14> buffer_;
};

std::unique_ptr<ByteSource> open_bytes(InputFile& file, const VtkArray& array) {
  std::unique_ptr<ByteSource> source;
  if (array.encoding == VtkArray::Encoding::kRaw)
    source = std::make_unique<RawBytes>(file);
  else
    source = std::make_unique<DecodedBytes>(file, array);
  if (array.is_compressed) return std::make_unique<InflatedBytes>(file, array, std::move(source));
  const std::uint64_t num_bytes = read_word(*source, array);
  check_length(file, array, num_bytes);
  if (num_bytes > file.remaining()) file.refuse_truncated();
  return source;
}

}  // namespace

std::optional<NumberType> vtk_type_named(std::string_view name) {
  const auto found = std::ranges::find(kTypeNames, name);
  if (found == kTypeNames.end()) return std::nullopt;
  return static_cast<NumberType>(found - kTypeNames.begin());
}

std::unique_ptr<VtkValues> open_vtk_values(InputFile& file, const VtkArray& array) {
  if (file.is_unpacked())
    file.skip_to(array.place);
  else
    file.seek(array.place);
  if (array.encoding == VtkArray::Encoding::kAscii)
    return std::make_unique<TextValues>(file, array);
  return std::make_unique<ByteValues>(array, open_bytes(file, array));
}

}  // namespace locvol
