#include "tools/cad/kept_messages.h"

#include <Message.hxx>
#include <Message_Messenger.hxx>
#include <algorithm>

namespace locvol::cad {

class KeptMessages::Printer : public Message_Printer {
 public:
  std::string first;

 protected:
  void send(const TCollection_AsciiString& text, const Message_Gravity gravity) const override {
    if (gravity < Message_Alarm || !first.empty()) return;
    std::string line = text.ToCString();
    std::ranges::replace(line, '\n', ' ');
    while (line.ends_with(' ')) line.pop_back();
    const_cast<Printer*>(this)->first = line;
  }
};

KeptMessages::KeptMessages() : printer_(new Printer) {
  Message::DefaultMessenger()->ChangePrinters().Clear();
  Message::DefaultMessenger()->AddPrinter(printer_);
}

KeptMessages::~KeptMessages() { Message::DefaultMessenger()->RemovePrinter(printer_); }

std::string KeptMessages::first_failure() const {
  return static_cast<const Printer&>(*printer_).first;
}

}  // namespace locvol::cad
