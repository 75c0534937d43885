#include "storage/page_check.h"

#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

// LMDB 0.9 on disk, 64 bits, little-endian. A page (its size is in the meta pages):
//
// clang-format off
//   | page number u64 | pad u16 | flags u16 | lower u16 | upper u16 | node offsets u16 ... (lower)
//   | free | (upper) nodes ... |        overflow pages: count u32 instead of lower and upper
// clang-format on
//
// The nodes fill the page from its end on without gaps, in any order, each of an even length.
// A node; in a branch page, size and flags together are the child's page number (48 bits). A value
// that does not fit is 8 bytes, the number of its first overflow page:
//
//   | size u32 | flags u16 | key size u16 | key | value |
//
// Pages 0 and 1 are the meta pages; commits write them in turn. After the page's header:
//
//   | magic u32 | version u32 | address u64 | map size u64 | free-list tree | main tree
//   | last page u64 | transaction u64 |
//
// A tree (48 bytes; also the value of a named database, in the main tree):
//
//   | page size in the free-list tree, else 0 u32 | flags u16 | depth u16 | branch pages u64
//   | leaf pages u64 | overflow pages u64 | entries u64 | root page u64, all ones if empty |
//
// The free list: transaction number u64 -> | count u64 | page numbers u64, descending ... |

namespace locvol {
namespace {

static_assert(std::endian::native == std::endian::little);

constexpr std::uint32_t kMagic = 0xBEEFC0DE;
constexpr std::uint32_t kVersion = 1;
constexpr std::size_t kPageHeader = 16;
constexpr std::size_t kNodeHeader = 8;
constexpr std::size_t kMetaBytes = kPageHeader + 24 + 2 * 48 + 16;
constexpr std::size_t kMaxKey = 511;
constexpr std::uint64_t kNumMetaPages = 2;
constexpr std::uint64_t kNoPage = ~std::uint64_t{0};
constexpr std::uint16_t kMaxDepth = 32;
enum PageFlags : std::uint16_t { kBranch = 0x01, kLeaf = 0x02, kOverflow = 0x04, kMeta = 0x08 };
enum NodeFlags : std::uint16_t { kBigValue = 0x01, kSubtree = 0x02 };
constexpr std::uint16_t kIntegerKeys = 0x08;

void require(bool holds, const char* otherwise) {
  if (!holds) throw DamagedFile(otherwise);
}

template <class T>
T load(std::string_view bytes, std::size_t at) {
  T value;
  std::memcpy(&value, bytes.data() + at, sizeof value);
  return value;
}

// Fills `bytes` from the file; a file that ends before it is damaged.
void read_at(int file, std::uint64_t offset, std::span<char> bytes) {
  while (!bytes.empty()) {
    const ssize_t n = pread(file, bytes.data(), bytes.size(), static_cast<off_t>(offset));
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) throw std::system_error(errno, std::generic_category(), "cannot be read");
    require(n > 0, "the file is shorter than its contents");
    bytes = bytes.subspan(static_cast<std::size_t>(n));
    offset += static_cast<std::uint64_t>(n);
  }
}

std::uint64_t size_of(int file) {
  struct stat status;
  if (fstat(file, &status) != 0)
    throw std::system_error(errno, std::generic_category(), "cannot be read");
  return static_cast<std::uint64_t>(status.st_size);
}

std::uint64_t num_overflow_pages(std::uint64_t value_bytes, std::uint32_t page_size) {
  return (kPageHeader - 1 + value_bytes) / page_size + 1;
}

struct Tree {
  std::uint16_t flags = 0, depth = 0;
  std::uint64_t num_branch = 0, num_leaf = 0, num_overflow = 0, num_entries = 0, root = kNoPage;

  static constexpr std::size_t kBytes = 48;
  static Tree load_from(std::string_view bytes, std::size_t at) {
    return {load<std::uint16_t>(bytes, at + 4),  load<std::uint16_t>(bytes, at + 6),
            load<std::uint64_t>(bytes, at + 8),  load<std::uint64_t>(bytes, at + 16),
            load<std::uint64_t>(bytes, at + 24), load<std::uint64_t>(bytes, at + 32),
            load<std::uint64_t>(bytes, at + 40)};
  }
};

struct Meta {
  std::uint32_t page_size = 0;
  Tree free_list, main;
  std::uint64_t last_page = 0, txn = 0;
};

bool is_page_size(std::uint32_t size) {
  return std::has_single_bit(size) && size >= 512 && size <= 32768;
}

Meta read_meta(int file, std::uint64_t page, std::uint32_t page_size) {
  std::array<char, kMetaBytes> buffer;
  read_at(file, page * page_size, buffer);
  const std::string_view bytes(buffer.data(), buffer.size());
  require(load<std::uint32_t>(bytes, kPageHeader) == kMagic, "not an LMDB file");
  require(load<std::uint32_t>(bytes, kPageHeader + 4) == kVersion,
          "an LMDB file of another version");
  require(load<std::uint64_t>(bytes, 0) == page && load<std::uint16_t>(bytes, 10) == kMeta,
          "a damaged meta page");
  const std::size_t trees = kPageHeader + 24;
  Meta meta{load<std::uint32_t>(bytes, trees), Tree::load_from(bytes, trees),
            Tree::load_from(bytes, trees + Tree::kBytes),
            load<std::uint64_t>(bytes, trees + 2 * Tree::kBytes),
            load<std::uint64_t>(bytes, trees + 2 * Tree::kBytes + 8)};
  require(is_page_size(meta.page_size), "a damaged meta page: page size");
  require(meta.free_list.flags == kIntegerKeys && meta.main.flags == 0,
          "a damaged meta page: flags");
  require(meta.last_page < (std::uint64_t{1} << 47) / meta.page_size,
          "a damaged meta page: number of pages");
  return meta;
}

std::array<Meta, 2> read_metas(int file) {
  // The second page starts where the first one says that pages do.
  const Meta first = read_meta(file, 0, 0);
  return {first, read_meta(file, 1, first.page_size)};
}

// Commits write the meta pages in turn, so the page follows from the transaction's number.
void check_turns(const std::array<Meta, 2>& metas) {
  require(metas[0].page_size == metas[1].page_size, "meta pages that contradict each other");
  const bool is_new = metas[0].txn == 0 && metas[1].txn == 0;
  const bool alternates = metas[0].txn % 2 == 0 && metas[1].txn % 2 == 1 &&
                          (metas[0].txn + 1 == metas[1].txn || metas[1].txn + 1 == metas[0].txn);
  require(is_new || alternates, "meta pages that contradict each other");
}

// A key as a bound: what is longer than any of ours is no bound.
class KeyBound {
 public:
  KeyBound() = default;
  explicit KeyBound(std::string_view key) {
    if (key.size() > bytes_.size()) return;
    size_ = static_cast<std::uint8_t>(key.size());
    std::ranges::copy(key, bytes_.begin());
  }
  bool is_set() const { return size_ <= bytes_.size(); }
  std::string_view key() const { return {bytes_.data(), size_}; }

 private:
  std::array<char, 23> bytes_{};
  std::uint8_t size_ = 0xff;
};

class PageChecker {
 public:
  PageChecker(int file, const Meta& meta)
      : file_(file),
        page_size_(meta.page_size),
        num_pages_(std::min(size_of(file) / meta.page_size, meta.last_page + 1)),
        last_page_(meta.last_page),
        txn_(meta.txn),
        is_used_(num_pages_ < kNumMetaPages ? kNumMetaPages : num_pages_) {}

  KeySumByName run(const Meta& meta);

 private:
  struct Node {
    std::uint32_t size;
    std::uint16_t flags;
    std::string_view key, value;  // value: all that is left of the page
    std::uint64_t child() const { return size | std::uint64_t{flags} << 32; }
  };
  struct Level {  // of a tree
    bool is_leaf = false;
    bool is_free_list = false;
  };

  // A page of a tree, and between which keys a search comes to it: low <= key < high.
  struct Place {
    std::uint64_t page = 0;
    KeyBound low, high;
  };

  void check_tree(const Tree& tree, bool is_free_list);
  void check_page(const Place& place, Level level);
  static bool is_less(std::string_view a, std::string_view b, Level level);
  void check_bounds(std::string_view key, const Place& place, Level level) const;
  void check_extents(std::size_t upper);
  void check_leaf_node(const Node& node, bool is_free_list);
  void check_free_pages(const Node& node);
  Node node_at(std::string_view page, std::size_t index) const;
  static std::pair<std::size_t, std::size_t> extent(std::string_view page, const Node& node,
                                                    Level level);
  std::uint64_t take_overflow_pages(const Node& node);
  void take(std::uint64_t page, std::uint64_t count = 1);

  int file_;
  std::uint32_t page_size_;
  std::uint64_t num_pages_;  // wholly in the file
  std::uint64_t last_page_;
  std::uint64_t txn_;
  std::vector<bool> is_used_;
  std::map<std::string, Tree> named_;  // databases, found in the main tree

  // Of the tree in hand.
  std::vector<Place> children_;
  Tree counted_;
  std::uint64_t key_sum_ = 0;
  std::vector<std::pair<std::size_t, std::size_t>> extents_;  // of a page's nodes: begin, bytes
};

KeySumByName PageChecker::run(const Meta& meta) {
  take(0, kNumMetaPages);
  check_tree(meta.main, false);
  const std::map<std::string, Tree> named = std::exchange(named_, {});
  KeySumByName sums;
  for (const auto& [name, tree] : named) {
    require(tree.flags == 0, "a named database of another kind");
    check_tree(tree, false);
    sums[name] = key_sum_;
  }
  require(named_.empty(), "a database within a named database");
  check_tree(meta.free_list, true);  // last: what is in use cannot be free
  return sums;
}

void PageChecker::check_tree(const Tree& tree, bool is_free_list) {
  require(tree.depth <= kMaxDepth, "a tree too deep");
  require((tree.depth == 0) == (tree.root == kNoPage), "a tree without a root");
  counted_ = Tree();
  key_sum_ = 0;
  std::vector<Place> places;
  if (tree.depth > 0) places.push_back({tree.root, {}, {}});
  for (int depth = 1; depth <= tree.depth; ++depth) {
    children_.clear();
    std::ranges::sort(places, {}, &Place::page);
    for (const Place& place : places) check_page(place, {depth == tree.depth, is_free_list});
    places.swap(children_);
  }
  require(counted_.num_branch == tree.num_branch && counted_.num_leaf == tree.num_leaf &&
              counted_.num_overflow == tree.num_overflow &&
              counted_.num_entries == tree.num_entries,
          "a tree that has lost or gained pages");
}

void PageChecker::check_page(const Place& place, Level level) {
  take(place.page);
  std::string page(page_size_, '\0');
  read_at(file_, place.page * page_size_, page);
  require(load<std::uint64_t>(page, 0) == place.page, "a page in another's place");
  require(load<std::uint16_t>(page, 10) == (level.is_leaf ? kLeaf : kBranch),
          "a page of another kind");
  const auto lower = load<std::uint16_t>(page, 12), upper = load<std::uint16_t>(page, 14);
  require(kPageHeader <= lower && lower <= upper && upper <= page_size_ && lower % 2 == 0,
          "a page with impossible bounds");
  const std::size_t num_nodes = (lower - kPageHeader) / 2;
  require(num_nodes >= (level.is_leaf || level.is_free_list ? 1u : 2u),
          "a page with too few nodes");
  std::optional<Node> before;
  extents_.clear();
  for (std::size_t i = 0; i < num_nodes; ++i) {
    const Node node = node_at(page, i);
    // The first key of a branch page stands for "less than the second", and is not looked at.
    const bool has_key = level.is_leaf || i > 0;
    if (has_key) check_bounds(node.key, place, level);
    if (before && (level.is_leaf || i > 1))
      require(is_less(before->key, node.key, level), "keys out of order");
    if (level.is_leaf) {
      check_leaf_node(node, level.is_free_list);
    } else {
      const KeyBound low = has_key ? KeyBound(node.key) : place.low;
      if (i > 0) children_.back().high = low;
      children_.push_back({node.child(), low, place.high});
    }
    extents_.push_back(extent(page, node, level));
    before = node;
  }
  check_extents(upper);
  ++(level.is_leaf ? counted_.num_leaf : counted_.num_branch);
  if (level.is_leaf) counted_.num_entries += num_nodes;
}

PageChecker::Node PageChecker::node_at(std::string_view page, std::size_t index) const {
  const std::size_t at = load<std::uint16_t>(page, kPageHeader + 2 * index);
  require(at % 2 == 0 && at >= load<std::uint16_t>(page, 14) && at + kNodeHeader <= page.size(),
          "a node outside its page");
  const std::size_t key_size = load<std::uint16_t>(page, at + 6);
  const std::size_t key = at + kNodeHeader;
  require(key_size <= kMaxKey && key + key_size <= page.size(), "a key outside its page");
  return {load<std::uint32_t>(page, at), load<std::uint16_t>(page, at + 4),
          page.substr(key, key_size), page.substr(key + key_size)};
}

bool PageChecker::is_less(std::string_view a, std::string_view b, Level level) {
  if (!level.is_free_list) return a < b;
  require(a.size() == 8 && b.size() == 8, "free pages of no transaction");
  return load<std::uint64_t>(a, 0) < load<std::uint64_t>(b, 0);
}

void PageChecker::check_bounds(std::string_view key, const Place& place, Level level) const {
  constexpr const char* kLost = "a key where no search would find it";
  if (place.low.is_set()) require(!is_less(key, place.low.key(), level), kLost);
  if (place.high.is_set()) require(is_less(key, place.high.key(), level), kLost);
}

// Node by node without a gap to the end of the page: where they are not, writing moves the wrong
// bytes, even beyond the page.
void PageChecker::check_extents(std::size_t upper) {
  std::ranges::sort(extents_);
  std::size_t end = upper;
  for (const auto& [begin, bytes] : extents_) {
    require(begin == end, "nodes that overlap");
    end += bytes;
  }
  require(end == page_size_, "nodes that overlap");
}

std::pair<std::size_t, std::size_t> PageChecker::extent(std::string_view page, const Node& node,
                                                        Level level) {
  const std::size_t value = !level.is_leaf ? 0 : node.flags == kBigValue ? 8 : node.size;
  const std::size_t bytes = kNodeHeader + node.key.size() + value;
  return {static_cast<std::size_t>(node.key.data() - page.data()) - kNodeHeader, bytes + bytes % 2};
}

void PageChecker::check_leaf_node(const Node& node, bool is_free_list) {
  require(node.flags == 0 || node.flags == kBigValue || node.flags == kSubtree,
          "a node of another kind");
  key_sum_ += key_hash(node.key);
  if (node.flags != kBigValue) require(node.size <= node.value.size(), "a value outside its page");
  if (node.flags == kSubtree) {
    require(node.size == Tree::kBytes && !is_free_list, "a named database cut short");
    named_.emplace(node.key, Tree::load_from(node.value, 0));
  } else if (is_free_list) {
    require(node.key.size() == 8 && load<std::uint64_t>(node.key, 0) <= txn_,
            "free pages of no transaction");
    check_free_pages(node);
  } else if (node.flags == kBigValue) {
    take_overflow_pages(node);
  }
}

std::uint64_t PageChecker::take_overflow_pages(const Node& node) {
  require(node.value.size() >= 8, "a value outside its page");
  const auto first = load<std::uint64_t>(node.value, 0);
  const std::uint64_t count = num_overflow_pages(node.size, page_size_);
  take(first, count);
  counted_.num_overflow += count;
  return first;
}

void PageChecker::check_free_pages(const Node& node) {
  std::string list(node.value.substr(0, std::min<std::size_t>(node.size, node.value.size())));
  if (node.flags == kBigValue) {
    const std::uint64_t first = take_overflow_pages(node);
    list.resize(node.size);
    read_at(file_, first * page_size_ + kPageHeader, list);
  }
  require(list.size() >= 8, "free pages cut short");
  const auto count = load<std::uint64_t>(list, 0);
  require(count < list.size() / 8, "free pages cut short");
  std::uint64_t before = last_page_ + 1;
  for (std::uint64_t i = 1; i <= count; ++i) {
    const auto page = load<std::uint64_t>(list, 8 * i);
    require(kNumMetaPages <= page && page < before, "a free page that cannot be");
    require(page >= num_pages_ || !is_used_[page], "a page both free and in use");
    if (page < num_pages_) is_used_[page] = true;
    before = page;
  }
}

// A page belongs in one place only, inside the file.
void PageChecker::take(std::uint64_t page, std::uint64_t count) {
  require(page < num_pages_ && count <= num_pages_ - page, "the file is shorter than its contents");
  for (std::uint64_t i = page; i < page + count; ++i) {
    require(!is_used_[i], "a page in use twice");
    is_used_[i] = true;
  }
}

}  // namespace

bool has_content(int file) try {
  constexpr std::uint64_t kMinPageBytes = 512;
  if (size_of(file) < kNumMetaPages * kMinPageBytes) return false;
  const Meta first = read_meta(file, 0, 0);
  if (size_of(file) < kNumMetaPages * first.page_size) return false;
  const Meta second = read_meta(file, 1, first.page_size);
  // LMDB's choice. When a commit fails to write its meta page, the page may say anything but for
  // its transaction, which then is an old one.
  return (first.txn < second.txn ? second : first).main.root != kNoPage;
} catch (const DamagedFile&) {
  return true;
}

void check_meta_pages(int file) {
  constexpr int kMaxTries = 3;  // a live writer may commit between the two reads
  for (int tries = 1;; ++tries) {
    try {
      return check_turns(read_metas(file));
    } catch (const DamagedFile&) {
      if (tries == kMaxTries) throw;
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  }
}

std::optional<KeySumByName> check_pages(int file, std::uint64_t txn) {
  for (const Meta& meta : read_metas(file))
    if (meta.txn == txn) return PageChecker(file, meta).run(meta);
  return std::nullopt;
}

std::uint64_t key_hash(std::string_view key) {
  std::uint64_t hash = 0xcbf29ce484222325;  // FNV-1a, whose low bits alone are good, then mixed
  for (const char c : key) hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001b3;
  hash = (hash ^ hash >> 32) * 0xd6e8feb86659fd93;
  return hash ^ hash >> 32;
}

// Right behind a page's header, there are node offsets in a page with nodes.
void check_overflow_header(const char* value, std::uint64_t value_bytes, std::uint64_t offset,
                           std::uint32_t page_size) {
  if (offset % page_size != kPageHeader) return;
  const std::string_view header(value - kPageHeader, kPageHeader);
  require(load<std::uint64_t>(header, 0) == offset / page_size &&
              load<std::uint16_t>(header, 10) == kOverflow &&
              load<std::uint32_t>(header, 12) == num_overflow_pages(value_bytes, page_size),
          "a damaged overflow page");
}

}  // namespace locvol
