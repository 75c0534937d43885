#include "engine/ingest/zip_archive.h"

#include <fmt/format.h>
#include <zlib.h>

#include <algorithm>
#include <cctype>
#include <new>
#include <span>
#include <utility>

#include "engine/ingest/number_bytes.h"
#include "engine/ingest/text_scanner.h"

namespace locvol {
namespace {

constexpr std::uint64_t kMostDirectoryBytes = std::uint64_t{1} << 24;
constexpr std::uint64_t kZipEndBytes = 22, kMostCommentBytes = 0xffff, kLocatorBytes = 20,
                        kEnd64Bytes = 56, kZipEntryBytes = 46, kZipHeadBytes = 30;
constexpr unsigned kStored = 0, kDeflated = 8, kEncryptedFlag = 1;

std::uint64_t zip_word(const unsigned char* bytes, std::size_t num) {
  return bits_in(bytes, num, false);
}

[[noreturn]] void refuse_zip(const InputBytes& bytes, const std::string& what) {
  bytes.refuse(
      fmt::format("its zip archive is damaged or cut off: {}; fetch or export it again", what));
}

// The bytes of one entry.
class ZipEntryStream : public UnpackedStream {
 public:
  ZipEntryStream(std::shared_ptr<const InputBytes> bytes, const ZipArchive::Entry& entry,
                 std::uint64_t place)
      : bytes_(std::move(bytes)), entry_(entry), place_(place), packed_left_(entry.packed_size) {
    if (entry_.method == kDeflated && inflateInit2(&z_, -15) != Z_OK) throw std::bad_alloc();
  }
  ZipEntryStream(const ZipEntryStream&) = delete;
  ZipEntryStream& operator=(const ZipEntryStream&) = delete;
  ~ZipEntryStream() override {
    if (entry_.method == kDeflated) inflateEnd(&z_);
  }

  std::size_t read(std::span<char> unpacked) override {
    if (is_at_end_) return 0;
    const std::size_t count = entry_.method == kStored ? copy(unpacked) : inflate_into(unpacked);
    crc_ = crc32_z(crc_, reinterpret_cast<const Bytef*>(unpacked.data()), count);
    num_read_ += count;
    if (num_read_ > entry_.size || (count == 0 && num_read_ != entry_.size))
      damaged(fmt::format("it has other than the {} bytes that the directory says", entry_.size));
    if (count == 0) {
      is_at_end_ = true;
      if (crc_ != entry_.crc) damaged("its checksum is another one");
    }
    return count;
  }

 private:
  [[noreturn]] void damaged(const std::string& what) const {
    refuse_zip(*bytes_, fmt::format("of \"{}\" {}", shown(entry_.name), what));
  }

  std::size_t copy(std::span<char> unpacked) {
    const auto most = std::min<std::uint64_t>(unpacked.size(), packed_left_);
    if (most == 0) return 0;
    const std::size_t count = bytes_->read_at(place_, unpacked.first(most));
    if (count == 0) damaged("the bytes end too early");
    place_ += count;
    packed_left_ -= count;
    return count;
  }

  std::size_t inflate_into(std::span<char> unpacked) {
    z_.next_out = reinterpret_cast<Bytef*>(unpacked.data());
    z_.avail_out = static_cast<uInt>(unpacked.size());
    while (z_.avail_out == unpacked.size() && !is_inflated_) {
      if (z_.avail_in == 0) load();
      const int result = inflate(&z_, Z_NO_FLUSH);
      if (result == Z_STREAM_END)
        is_inflated_ = true;
      else if (result == Z_MEM_ERROR)
        throw std::bad_alloc();
      else if (result != Z_OK && result != Z_BUF_ERROR)
        damaged(fmt::format("the packed bytes make no sense before byte {}", place_ - z_.avail_in));
    }
    return unpacked.size() - z_.avail_out;
  }

  void load() {
    const auto most = std::min<std::uint64_t>(packed_.size(), packed_left_);
    const std::size_t count =
        most == 0 ? 0 : bytes_->read_at(place_, std::span(packed_).first(most));
    if (count == 0) damaged("the packed bytes end too early");
    place_ += count;
    packed_left_ -= count;
    z_.next_in = reinterpret_cast<Bytef*>(packed_.data());
    z_.avail_in = static_cast<uInt>(count);
  }

  std::shared_ptr<const InputBytes> bytes_;
  ZipArchive::Entry entry_;
  std::uint64_t place_, packed_left_;
  z_stream z_{};
  std::vector<char> packed_ = std::vector<char>(std::size_t{1} << 16);
  uLong crc_ = 0;
  std::uint64_t num_read_ = 0;
  bool is_inflated_ = false, is_at_end_ = false;
};

bool is_same_name(std::string_view a, std::string_view b) {
  return std::ranges::equal(
      a, b, [](unsigned char x, unsigned char y) { return std::tolower(x) == std::tolower(y); });
}

}  // namespace

bool ZipArchive::is_zip(const InputBytes& bytes) {
  char head[4];
  return bytes.read_at(0, head) == sizeof head && std::string_view(head, 4) == "PK\3\4";
}

ZipArchive::ZipArchive(std::shared_ptr<const InputBytes> bytes) : bytes_(std::move(bytes)) {
  read_entries(find_directory());
}

std::vector<unsigned char> ZipArchive::read(std::uint64_t place, std::uint64_t bytes) const {
  if (place > bytes_->size() || bytes > bytes_->size() - place)
    refuse_zip(*bytes_, fmt::format("{} bytes at byte {} are not there", bytes, place));
  std::vector<unsigned char> data(bytes);
  for (std::uint64_t done = 0; done < bytes;) {
    const std::size_t count = bytes_->read_at(
        place + done, {reinterpret_cast<char*>(data.data() + done), data.size() - done});
    if (count == 0) refuse_zip(*bytes_, "it became shorter");
    done += count;
  }
  return data;
}

ZipArchive::Directory ZipArchive::find_directory() const {
  const std::uint64_t tail_bytes = std::min(bytes_->size(), kZipEndBytes + kMostCommentBytes);
  const std::uint64_t tail_place = bytes_->size() - tail_bytes;
  const std::vector<unsigned char> tail = read(tail_place, tail_bytes);
  const std::string_view text(reinterpret_cast<const char*>(tail.data()), tail.size());
  const std::size_t end = text.rfind("PK\5\6");
  if (end == text.npos || tail.size() - end < kZipEndBytes)
    refuse_zip(*bytes_, "it has no directory at its end");
  const unsigned char* const record = tail.data() + end;
  Directory directory{zip_word(record + 16, 4), zip_word(record + 12, 4), zip_word(record + 10, 2)};
  const std::uint64_t end_place = tail_place + end;
  if (directory.place == 0xffffffff || directory.bytes == 0xffffffff ||
      directory.num_entries == 0xffff) {
    if (end_place < kLocatorBytes) refuse_zip(*bytes_, "it has no directory of Zip64");
    const auto locator = read(end_place - kLocatorBytes, kLocatorBytes);
    if (zip_word(locator.data(), 4) == 0x07064b50) {
      const auto end64 = read(zip_word(locator.data() + 8, 8), kEnd64Bytes);
      if (zip_word(end64.data(), 4) != 0x06064b50)
        refuse_zip(*bytes_, "it has no directory of Zip64");
      directory = {zip_word(end64.data() + 48, 8), zip_word(end64.data() + 40, 8),
                   zip_word(end64.data() + 32, 8)};
    }
  }
  if (directory.bytes > kMostDirectoryBytes)
    bytes_->refuse(fmt::format("its zip archive has a directory of {} bytes, more than {}",
                               directory.bytes, kMostDirectoryBytes));
  return directory;
}

void ZipArchive::read_entries(const Directory& directory) {
  const std::vector<unsigned char> data = read(directory.place, directory.bytes);
  std::uint64_t at = 0;
  for (std::uint64_t i = 0; i < directory.num_entries; ++i) {
    const unsigned char* const head = data.data() + at;
    if (data.size() - at < kZipEntryBytes || zip_word(head, 4) != 0x02014b50)
      refuse_zip(*bytes_, fmt::format("its directory has no entry {}", i + 1));
    const std::uint64_t name_bytes = zip_word(head + 28, 2), extra_bytes = zip_word(head + 30, 2),
                        comment_bytes = zip_word(head + 32, 2);
    const std::uint64_t entry_bytes = kZipEntryBytes + name_bytes + extra_bytes + comment_bytes;
    if (data.size() - at < entry_bytes)
      refuse_zip(*bytes_, fmt::format("its directory ends in entry {}", i + 1));
    Entry entry;
    entry.name.assign(reinterpret_cast<const char*>(head + kZipEntryBytes), name_bytes);
    entry.flags = static_cast<unsigned>(zip_word(head + 8, 2));
    entry.method = static_cast<unsigned>(zip_word(head + 10, 2));
    entry.crc = static_cast<std::uint32_t>(zip_word(head + 16, 4));
    entry.packed_size = zip_word(head + 20, 4);
    entry.size = zip_word(head + 24, 4);
    entry.head = zip_word(head + 42, 4);
    // What does not fit into 32 bits stands in an extra field, in this order.
    const unsigned char* extra = head + kZipEntryBytes + name_bytes;
    const unsigned char* const extra_end = extra + extra_bytes;
    while (extra_end - extra >= 4) {
      const std::uint64_t id = zip_word(extra, 2);
      const auto bytes = static_cast<std::ptrdiff_t>(zip_word(extra + 2, 2));
      const unsigned char* value = extra + 4;
      if (bytes > extra_end - value) break;
      const unsigned char* const value_end = value + bytes;
      if (id == 1)
        for (std::uint64_t* const field : {&entry.size, &entry.packed_size, &entry.head})
          if (*field == 0xffffffff && value_end - value >= 8) {
            *field = zip_word(value, 8);
            value += 8;
          }
      extra = value_end;
    }
    entries_.push_back(std::move(entry));
    at += entry_bytes;
  }
}

const ZipArchive::Entry* ZipArchive::find(std::string_view name) const {
  if (name.starts_with('/')) name.remove_prefix(1);
  for (const Entry& entry : entries_)
    if (is_same_name(entry.name, name)) return &entry;
  return nullptr;
}

InputFile ZipArchive::open(const Entry& entry, const StopToken* stop) const {
  if ((entry.flags & kEncryptedFlag) != 0)
    bytes_->refuse(
        fmt::format("\"{}\" in it is encrypted; save it without a password", shown(entry.name)));
  if (entry.method != kStored && entry.method != kDeflated)
    bytes_->refuse(fmt::format("\"{}\" in it is packed by method {}; save it with zip's usual one",
                               shown(entry.name), entry.method));
  const auto head = read(entry.head, kZipHeadBytes);
  if (zip_word(head.data(), 4) != 0x04034b50)
    refuse_zip(*bytes_, fmt::format("\"{}\" is not at byte {}", shown(entry.name), entry.head));
  const std::uint64_t place =
      entry.head + kZipHeadBytes + zip_word(head.data() + 26, 2) + zip_word(head.data() + 28, 2);
  const auto stream = [bytes = bytes_, entry, place] {
    return std::make_unique<ZipEntryStream>(bytes, entry, place);
  };
  return {bytes_, shown(entry.name), stream, entry.size, stop};
}

}  // namespace locvol
