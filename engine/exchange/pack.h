// Values as bytes, for another rank: of the same program, on a machine of the same kind. Of what
// has fields() (refine/leaf_fields.h), which are to be declared before this is used.
#pragma once

#include <boost/archive/binary_iarchive.hpp>
#include <boost/archive/binary_oarchive.hpp>
#include <boost/serialization/array.hpp>
#include <boost/serialization/map.hpp>
#include <boost/serialization/string.hpp>
#include <boost/serialization/vector.hpp>
#include <new>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "engine/exchange/exchange.h"
#include "engine/shared/compensated_sum.h"
#include "octree/morton_key.h"
#include "refine/leaf_fields.h"

namespace boost::serialization {

template <class Archive, locvol::HasFields T>
void serialize(Archive& archive, T& value, unsigned) {
  locvol::for_each_field(value, [&](const char*, auto& member) { archive& member; });
}

template <class Archive>
void serialize(Archive& archive, locvol::MortonKey& key, unsigned) {
  std::uint64_t bits = key.bits();
  archive& bits;
  key = locvol::MortonKey::from_bits(bits);
}

template <class Archive, class T>
void serialize(Archive& archive, std::optional<T>& value, unsigned) {
  bool is_there = value.has_value();
  archive& is_there;
  if (is_there && !value) value.emplace();
  if (is_there) archive&* value;
}

// Classes are packed without versions and addresses, which are of no use here.
template <locvol::HasFields T>
struct implementation_level<T> : mpl::int_<object_serializable> {};
template <locvol::HasFields T>
struct tracking_level<T> : mpl::int_<track_never> {};

}  // namespace boost::serialization

BOOST_CLASS_IMPLEMENTATION(locvol::MortonKey, object_serializable)

// Points are packed in one piece, for they are many.
BOOST_IS_BITWISE_SERIALIZABLE(locvol::Point)
BOOST_IS_BITWISE_SERIALIZABLE(locvol::LatticeSite)
BOOST_IS_BITWISE_SERIALIZABLE(locvol::LatticeRow)
BOOST_IS_BITWISE_SERIALIZABLE(locvol::MeshCell)
namespace boost::serialization {
template <>
struct is_bitwise_serializable<std::array<std::uint32_t, 4>> : mpl::true_ {};
}  // namespace boost::serialization

namespace locvol {

auto fields(Maybe<CompensatedSum> auto& sum) {
  auto [whole, lost] = CompensatedSum::members(sum);
  return std::tuple(Field("sum", whole), Field("lost", lost));
}

inline constexpr unsigned kPackFlags = boost::archive::no_header | boost::archive::no_codecvt;

template <class T>
std::string pack(const T& value) {
  std::ostringstream stream;
  boost::archive::binary_oarchive archive(stream, kPackFlags);
  archive << value;
  return std::move(stream).str();
}

// Throws ExchangeError: the bytes are of no such value.
template <class T>
T unpack(std::string_view bytes) try {
  std::istringstream stream{std::string(bytes)};
  boost::archive::binary_iarchive archive(stream, kPackFlags);
  T value;
  archive >> value;
  return value;
} catch (const boost::archive::archive_exception& e) {
  throw ExchangeError(std::string("what another rank said did not arrive whole: ") + e.what());
} catch (const std::bad_alloc&) {  // it asks for more than there can be
  throw ExchangeError("what another rank said is something else, or did not arrive whole");
} catch (const std::length_error&) {
  throw ExchangeError("what another rank said is something else, or did not arrive whole");
}

// The values of all ranks, by rank.
template <class T>
std::vector<T> gather_values(Exchange& exchange, const T& own) {
  std::vector<T> values;
  for (const std::string& message : exchange.gather(pack(own)))
    values.push_back(unpack<T>(message));
  return values;
}

// The lists of all ranks, one after another.
template <class T>
std::vector<T> gather_all(Exchange& exchange, const std::vector<T>& own) {
  std::vector<T> all;
  for (std::string& message : exchange.gather(pack(own))) {
    const auto of_rank = unpack<std::vector<T>>(std::exchange(message, {}));
    all.insert(all.end(), of_rank.begin(), of_rank.end());
  }
  return all;
}

// A list to each rank, by rank; gives those to this one. Of an empty one nothing is said.
template <class T>
std::vector<std::vector<T>> swap_lists(Exchange& exchange, std::vector<std::vector<T>> lists) {
  std::vector<std::string> messages;
  for (std::vector<T>& list : lists) {
    messages.push_back(list.empty() ? std::string() : pack(list));
    list = {};
  }
  messages = exchange.swap(std::move(messages));
  for (std::size_t rank = 0; rank < messages.size(); ++rank) {
    if (!messages[rank].empty()) lists[rank] = unpack<std::vector<T>>(messages[rank]);
    messages[rank] = {};
  }
  return lists;
}

}  // namespace locvol
