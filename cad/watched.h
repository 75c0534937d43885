// How OpenCASCADE's work is watched: it asks whether it may go on, and what it says is kept.
#pragma once

#include <Message_Printer.hxx>
#include <Message_ProgressIndicator.hxx>
#include <fstream>
#include <istream>
#include <streambuf>
#include <string>
#include <vector>

#include "cad/shape_file.h"

namespace locvol::cad {

inline void require_time(CadWatch& watch) {
  if (!watch.may_go_on()) throw Ended();
}

// OpenCASCADE asks it often, and ends what it does where it is to.
class WatchedProgress : public Message_ProgressIndicator {
 public:
  explicit WatchedProgress(CadWatch& watch) : watch_(watch) {}
  Standard_Boolean UserBreak() override { return !watch_.may_go_on(); }
  void Show(const Message_ProgressScope&, const Standard_Boolean) override {}

 private:
  CadWatch& watch_;
};

// Ends the file where work is to end: a parser then gives up soon.
class WatchedFile : public std::streambuf {
 public:
  WatchedFile(const std::string& path, CadWatch& watch) : watch_(watch), buffer_(kBytes) {
    file_.open(path, std::ios::in | std::ios::binary);
    if (!file_) throw Refusal("cannot be opened by OpenCASCADE");
  }

 protected:
  int_type underflow() override {
    if (!watch_.may_go_on()) return traits_type::eof();
    const auto count = file_.sgetn(buffer_.data(), static_cast<std::streamsize>(buffer_.size()));
    if (count <= 0) return traits_type::eof();
    setg(buffer_.data(), buffer_.data(), buffer_.data() + count);
    return traits_type::to_int_type(buffer_.front());
  }

 private:
  static constexpr std::size_t kBytes = std::size_t{1} << 16;

  struct : std::filebuf {
    explicit operator bool() const { return is_open(); }
  } file_;
  CadWatch& watch_;
  std::vector<char> buffer_;
};

// What OpenCASCADE would print. While it stands, nothing is printed.
class KeptMessages {
 public:
  KeptMessages();
  ~KeptMessages();
  KeptMessages(const KeptMessages&) = delete;
  KeptMessages& operator=(const KeptMessages&) = delete;

  // The first message of a failure; empty: there is none.
  std::string first_failure() const;

 private:
  class Printer;
  Handle(Message_Printer) printer_;
};

}  // namespace locvol::cad
