// The plain functions, which OpenSSL 3 calls deprecated: they allocate nothing. What replaces them
// crashes when its first use finds no memory (OpenSSL 3.0: EVP_MD_fetch() locks a lock that was not
// made).
#define OPENSSL_SUPPRESS_DEPRECATED

#include "engine/ingest/sha256.h"

#include <fmt/format.h>
#include <openssl/sha.h>

#include <array>
#include <cassert>
#include <cstring>

namespace locvol {

struct Sha256::Impl {
  SHA256_CTX context;
};

Sha256::Sha256() : impl_(std::make_unique<Impl>()) { SHA256_Init(&impl_->context); }
Sha256::Sha256(Sha256&&) noexcept = default;
Sha256& Sha256::operator=(Sha256&&) noexcept = default;
Sha256::~Sha256() = default;

void Sha256::update(const void* data, std::size_t bytes) {
  SHA256_Update(&impl_->context, data, bytes);
}

std::string Sha256::state() const {
  return {reinterpret_cast<const char*>(&impl_->context), sizeof impl_->context};
}

Sha256 Sha256::from_state(std::string_view state) {
  Sha256 hash;
  assert(state.size() == sizeof hash.impl_->context);
  std::memcpy(&hash.impl_->context, state.data(), sizeof hash.impl_->context);
  return hash;
}

std::string Sha256::hex_digest() {
  std::array<unsigned char, SHA256_DIGEST_LENGTH> digest;
  SHA256_Final(digest.data(), &impl_->context);
  std::string digits;
  for (const unsigned char byte : digest) digits += fmt::format("{:02x}", byte);
  return digits;
}

}  // namespace locvol
