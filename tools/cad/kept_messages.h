// What OpenCASCADE would print.
#pragma once

#include <Message_Printer.hxx>
#include <string>

namespace locvol::cad {

// While it stands, nothing is printed.
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
