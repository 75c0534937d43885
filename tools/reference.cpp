#include "tools/reference.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cctype>
#include <string>
#include <vector>

#include "tools/generate.h"

namespace locvol {
namespace {

// What an option or a positional argument takes, as far as a shell can complete it.
struct Values {
  enum class Kind { kNone, kAny, kFiles, kSurfaces, kDirectories, kWords } kind = Kind::kNone;
  std::vector<std::string> words;
};

struct OptionEntry {
  std::vector<std::string> names;  // with their dashes, short ones first
  std::string value;               // its name; empty: a flag
  std::string description;
  Values values;
  bool is_required = false;

  bool is_flag() const { return value.empty(); }
};

struct CommandEntry {
  std::string name, description, footer;
  std::vector<OptionEntry> positionals, options;
};

constexpr std::array kSurfaceExtensions = {"stl", "obj", "off", "ply"};

std::vector<std::string> split(const std::string& text, char separator) {
  std::vector<std::string> parts(1);
  for (const char c : text) {
    if (c == separator)
      parts.emplace_back();
    else
      parts.back() += c;
  }
  return parts;
}

Values values_named(const std::string& name) {
  using Kind = Values::Kind;
  if (name.empty()) return {};
  if (name == "FILE") return {Kind::kFiles, {}};
  if (name == "SURFACE") return {Kind::kSurfaces, {}};
  if (name == "DIR") return {Kind::kDirectories, {}};
  if (name == "SHAPE") {
    Values values{Kind::kWords, {}};
    for (const ShapeInfo& shape : shapes()) values.words.emplace_back(shape.name);
    values.words.emplace_back(kPolycrystal);
    return values;
  }
  if (name.find('|') != std::string::npos) return {Kind::kWords, split(name, '|')};
  return {Kind::kAny, {}};
}

// CLI11 gives a positional argument with a type of its own that type's name, too.
OptionEntry entry_of(const CLI::Option& option) {
  OptionEntry entry;
  for (const std::string& name : option.get_snames()) entry.names.push_back("-" + name);
  for (const std::string& name : option.get_lnames()) entry.names.push_back("--" + name);
  entry.description = option.get_description();
  entry.is_required = option.get_required();
  const bool is_positional = entry.names.empty();
  if (is_positional || option.get_expected_max() > 0)
    entry.value = is_positional ? option.get_name(true) : option.get_type_name();
  const std::string type = option.get_type_name();
  entry.values = values_named(is_positional && !type.empty() ? type : entry.value);
  return entry;
}

// With the options of its groups, each of which has the help flag again.
void add_options(const CLI::App& app, CommandEntry& command) {
  for (const CLI::Option* option : app.get_options()) {
    if (app.get_name().empty() && option == app.get_help_ptr()) continue;
    OptionEntry entry = entry_of(*option);
    (entry.names.empty() ? command.positionals : command.options).push_back(std::move(entry));
  }
  for (const CLI::App* group :
       app.get_subcommands([](const CLI::App* a) { return a->get_name().empty(); }))
    add_options(*group, command);
}

CommandEntry entry_of(const CLI::App& app) {
  CommandEntry command{app.get_name(), app.get_description(), "", {}, {}};
  // Otherwise it is the parent's.
  if (app.get_parent() != nullptr && app.get_footer() != app.get_parent()->get_footer())
    command.footer = app.get_footer();
  add_options(app, command);
  return command;
}

std::vector<CommandEntry> commands_of(const CLI::App& app) {
  std::vector<CommandEntry> commands;
  for (const CLI::App* command :
       app.get_subcommands([](const CLI::App* a) { return !a->get_name().empty(); }))
    commands.push_back(entry_of(*command));
  return commands;
}

std::string joined(const std::vector<std::string>& parts, std::string_view separator) {
  return fmt::format("{}", fmt::join(parts, separator));
}

std::string replaced(std::string text, std::string_view what, std::string_view by) {
  for (std::size_t i = 0; (i = text.find(what, i)) != std::string::npos; i += by.size())
    text.replace(i, what.size(), by);
  return text;
}

// The manual page.

std::string roff(const std::string& text) {
  std::string escaped = replaced(replaced(text, "\\", "\\e"), "-", "\\-");
  escaped = replaced(escaped, "\n.", "\n\\&.");
  return escaped.starts_with('.') || escaped.starts_with('\'') ? "\\&" + escaped : escaped;
}

std::string bold(const std::string& text) { return "\\fB" + roff(text) + "\\fR"; }
std::string italic(const std::string& text) { return "\\fI" + roff(text) + "\\fR"; }

std::string man_synopsis(const CLI::App& app, const CommandEntry& command) {
  std::string text = bold(app.get_name() + " " + command.name);
  for (const OptionEntry& p : command.positionals)
    text += p.is_required ? " " + italic(p.value) : " [" + italic(p.value) + "]";
  for (const OptionEntry& o : command.options)
    if (o.is_required) text += " " + bold(o.names.front()) + " " + italic(o.value);
  return text + " [" + italic("option") + " ...]\n";
}

std::string man_option(const OptionEntry& option) {
  std::vector<std::string> names;
  for (const std::string& name : option.names) names.push_back(bold(name));
  std::string text = ".TP\n" + joined(names, ", ");
  if (!option.is_flag()) text += (names.empty() ? "" : " ") + italic(option.value);
  return text + "\n" + roff(option.description) + (option.is_required ? " (required)" : "") + "\n";
}

std::string man_command(const CLI::App& app, const CommandEntry& command) {
  std::string text = ".SS " + man_synopsis(app, command) + roff(command.description) + ".\n";
  for (const OptionEntry& entry : command.positionals) text += man_option(entry);
  for (const OptionEntry& entry : command.options)
    if (entry.names.front() != "-h") text += man_option(entry);
  if (!command.footer.empty()) text += ".PP\n.nf\n" + roff(command.footer) + ".fi\n";
  return text;
}

constexpr std::string_view kManDescription =
    R"(fills a closed surface with tetrahedra by localized Delaunay refinement, on disk: the leaves
of an octree are loaded from a store, refined one at a time, committed, and streamed out at the end.
It is for models that do not fit into memory, and for runs that take hours: after an interruption,
whether by a signal, a crash or a power cut, the same command goes on to the same bytes.
.PP
The mesh is a subcomplex of the Delaunay triangulation of its vertices; its boundary is a 2\-manifold
with every vertex on the surface; circumradii are below λ, the size asked for, and radius\-edge ratios
at most 2. Cells get no dihedral angle below 15 degrees
.RB ( \-\-min\-dihedral );
the few that nothing improves are told. The mesh does not depend on the number of threads, the cap on
memory, or interruptions.
)";

constexpr std::string_view kManEnd =
    R"(.SH EXIT STATUS
.TP
.B 0
Done, also where cells keep an angle below
.BR \-\-min\-dihedral ;
.BR audit :
the mesh is valid.
.TP
.B 1
An error, whose reason is on standard error, and no output file;
.BR audit :
the mesh is not valid;
.BR inspect :
the store is damaged;
.BR replay :
a clean leaf comes out otherwise.
.TP
.B 2
The command line is at fault.
.TP
.B 3
Done and written, but some sites are unresolved: the surface is not smooth there at the scale λ.
.B locvol inspect
.I DIR
.B \-\-unresolved
lists them.
.TP
.B 4
Interrupted by SIGINT or SIGTERM, and resumable. A second signal ends the process at once.
.SH FILES
.TP
.IB OUTPUT .locvol
The store of a run for which
.B \-\-store
names none; removed when the run ends with exit status 0. It must be on a local disk.
.TP
.IB OUTPUT .partial
The output while it is being written. It appears under its name only when it is whole.
.SH ENVIRONMENT
.TP
.B TMPDIR
Where
.B locvol info
puts its temporary files.
.SH EXAMPLES
.nf
locvol generate octahandles \-o octahandles.stl \-\-triangles 50k
locvol mesh octahandles.stl \-o octahandles.vtu \-\-size 5%
locvol mesh scan.ply \-o scan.vtu \-\-size 0.5% \-\-memory 2G \-\-store run
locvol resume run \-o scan.vtu
xz \-dc part.stl.xz | locvol mesh \- \-o part.vtu
locvol inspect run \-\-leaves \-\-sort cells \-\-limit 10
locvol audit run
.fi
.SH SEE ALSO
T. K. Dey and A. G. Slatton, "Localized Delaunay Refinement for Volumes", Computer Graphics Forum
30(5), 2011.
)";

constexpr std::string_view kManDescriptionOfRanks =
    R"(is
.BR locvol (1)
by all processes of an MPI job at once, its ranks: on one machine or many. The mesh is the same, byte
by byte, for any number of them.
.PP
Each rank has a store of its own, on a disk of its own, which no other needs to see: in the name that
.B \-\-store
gives,
.B %r
is its number. The directory of the output has to be seen by all. So has the surface, which all read
if it is binary STL or binary PLY; any other, or one that others do not see, the first rank reads.
.B \-\-memory
and
.B \-\-threads
are a rank's. Progress is one line, of all.
.PP
After an end of any kind, of a rank or of all, the same command goes on, and so does
.BR "locvol\-mpi resume" .
After a stop (SIGINT, SIGUSR1) any number of ranks does. A rank whose store is gone, or is of another
run, is named.
)";

constexpr std::string_view kManEndOfRanks =
    R"(.SH EXIT STATUS
As of
.BR locvol (1).
A rank that fails ends the job.
.SH FILES
.TP
.IB OUTPUT .locvol\- N
The store of rank N, if
.B \-\-store
names none; removed when the run ends with exit status 0.
.TP
.IB STORE .next
A store to which leaves were moving when the run ended. Settled when it goes on.
.SH EXAMPLES
.nf
mpirun \-n 8 locvol\-mpi mesh part.stl \-o part.vtu \-\-size 0.5% \-\-memory 4G \-\-store /local/part\-%r
mpirun \-n 8 locvol\-mpi resume /local/part\-%r \-o part.vtu
mpirun \-n 8 locvol\-mpi join /local/part\-%r /scratch/part && locvol audit /scratch/part
.fi
.SH SEE ALSO
.BR locvol (1),
.BR mpirun (1)
)";

std::string man_page(const CLI::App& app, const std::vector<CommandEntry>& commands) {
  const bool is_of_ranks = app.get_name() == "locvol-mpi";
  std::string title = app.get_name();
  std::ranges::transform(title, title.begin(), [](unsigned char c) { return std::toupper(c); });
  std::string text = fmt::format(
      ".TH {} 1 \"\" \"{}\" \"User Commands\"\n.SH NAME\n{} \\- {}\n.SH SYNOPSIS\n", title,
      app.version(), roff(app.get_name()),
      roff(is_of_ranks ? "mesh the volume inside a closed surface by many processes"
                       : "mesh the volume inside a closed surface with tetrahedra, out of core"));
  for (const CommandEntry& command : commands) text += man_synopsis(app, command) + ".br\n";
  text += fmt::format(".SH DESCRIPTION\n.B {}\n{}.SH OPTIONS\n", roff(app.get_name()),
                      is_of_ranks ? kManDescriptionOfRanks : kManDescription);
  for (const OptionEntry& option : entry_of(app).options) text += man_option(option);
  text += ".SH COMMANDS\n";
  for (const CommandEntry& command : commands) text += man_command(app, command);
  return text.append(is_of_ranks ? kManEndOfRanks : kManEnd);
}

// bash

std::vector<std::string> names_of(const std::vector<CommandEntry>& commands) {
  std::vector<std::string> names;
  for (const CommandEntry& command : commands) names.push_back(command.name);
  return names;
}

std::vector<std::string> option_names(const CommandEntry& command) {
  std::vector<std::string> names;
  for (const OptionEntry& option : command.options)
    names.insert(names.end(), option.names.begin(), option.names.end());
  return names;
}

std::string bash_values(const Values& values) {
  switch (values.kind) {
    case Values::Kind::kFiles:
      return "_locvol_files ''";
    case Values::Kind::kSurfaces:
      return fmt::format("_locvol_files '\\.({})(\\.gz)?$'", fmt::join(kSurfaceExtensions, "|"));
    case Values::Kind::kDirectories:
      return "_locvol_files '^$'";
    case Values::Kind::kWords:
      return fmt::format("_locvol_words '{}'", joined(values.words, " "));
    case Values::Kind::kAny:
    case Values::Kind::kNone:
      break;
  }
  return ":";
}

std::string bash_command(const CommandEntry& command) {
  std::string text = fmt::format("    {})\n      case $prev in\n", command.name);
  for (const OptionEntry& option : command.options)
    if (!option.is_flag())
      text += fmt::format("        {}) {}; return ;;\n", joined(option.names, "|"),
                          bash_values(option.values));
  text += fmt::format("      esac\n      if [[ $cur == -* ]]; then _locvol_words '{}'\n",
                      joined(option_names(command), " "));
  text += fmt::format(
      "      else {}; fi ;;\n",
      bash_values(command.positionals.empty() ? Values() : command.positionals.front().values));
  return text;
}

constexpr std::string_view kBashBegin = R"(# Completion of locvol's command line in bash.

_locvol_words() {
  mapfile -t COMPREPLY < <(compgen -W "$1" -- "$cur")
}

# Directories, and files that match.
_locvol_files() {
  compopt -o filenames 2>/dev/null
  mapfile -t COMPREPLY < <(compgen -d -- "$cur"; comm -13 <(compgen -d -- "$cur" | sort) \
    <(compgen -f -- "$cur" | sort) | grep -iE -- "$1")
}

_locvol() {
  local cur=${COMP_WORDS[COMP_CWORD]} prev=${COMP_WORDS[COMP_CWORD-1]} command='' i
  COMPREPLY=()
  if [[ $cur == = ]]; then cur=''
  elif [[ $prev == = ]]; then prev=${COMP_WORDS[COMP_CWORD-2]}; fi
)";

std::string bash_script(const CLI::App& app, const std::vector<CommandEntry>& commands) {
  const std::string names = joined(names_of(commands), "|");
  std::string text(kBashBegin);
  text += fmt::format(
      "  for ((i = 1; i < COMP_CWORD; ++i)); do\n    case ${{COMP_WORDS[i]}} in\n"
      "      {}) command=${{COMP_WORDS[i]}}; break ;;\n    esac\n  done\n  case $command in\n",
      names);
  for (const CommandEntry& command : commands) text += bash_command(command);
  return text + fmt::format(
                    "    *) _locvol_words '{} {}' ;;\n  esac\n}}\n\ncomplete -F _locvol "
                    "locvol\n",
                    joined(names_of(commands), " "), joined(option_names(entry_of(app)), " "));
}

// zsh

std::string single_quoted(const std::string& text) {
  return "'" + replaced(text, "'", "'\\''") + "'";
}

std::string zsh_text(std::string text) {
  for (const char* c : {"\\", "[", "]", ":"}) text = replaced(text, c, std::string("\\") + c);
  return text;
}

std::string zsh_values(const Values& values) {
  switch (values.kind) {
    case Values::Kind::kFiles:
      return "_files";
    case Values::Kind::kSurfaces:
      return fmt::format("_files -g \"(#i)*.({})(|.gz)\"", fmt::join(kSurfaceExtensions, "|"));
    case Values::Kind::kDirectories:
      return "_files -/";
    case Values::Kind::kWords:
      return fmt::format("({})", joined(values.words, " "));
    case Values::Kind::kAny:
    case Values::Kind::kNone:
      break;
  }
  return " ";
}

std::string zsh_option(const OptionEntry& option) {
  const std::string value =
      option.is_flag() ? "" : ":" + zsh_text(option.value) + ":" + zsh_values(option.values);
  const std::string spec = single_quoted("[" + zsh_text(option.description) + "]" + value);
  const bool is_single = option.names.size() == 1;
  const std::string names =
      is_single ? option.names.front()
                : fmt::format("'({})'{{{}}}", joined(option.names, " "), joined(option.names, ","));
  return fmt::format(" \\\n        {}{}", names, spec);
}

std::string zsh_command(const CommandEntry& command) {
  std::string text = fmt::format("    {})\n      _arguments", command.name);
  for (const OptionEntry& option : command.options) text += zsh_option(option);
  for (const OptionEntry& p : command.positionals)
    text += " \\\n        " + single_quoted(":" + p.value + ":" + zsh_values(p.values));
  return text + " ;;\n";
}

std::string zsh_script(const CLI::App& app, const std::vector<CommandEntry>& commands) {
  std::string text =
      "#compdef locvol\n# Completion of locvol's command line in zsh.\n\n_locvol() {\n"
      "  local curcontext=$curcontext state line\n  local -a commands\n"
      "  commands=(\n";
  for (const CommandEntry& command : commands)
    text +=
        fmt::format("    {}\n", single_quoted(command.name + ":" + zsh_text(command.description)));
  text += "  )\n  _arguments -C";
  for (const OptionEntry& option : entry_of(app).options) text += zsh_option(option);
  text +=
      " \\\n        '1: :->command' '*:: :->arguments'\n"
      "  if [[ $state == command ]]; then _describe command commands; return; fi\n"
      "  case $words[1] in\n";
  for (const CommandEntry& command : commands) text += zsh_command(command);
  return text +
         "  esac\n}\n\nif [[ $funcstack[1] == _locvol ]]; then _locvol \"$@\"\n"
         "else compdef _locvol locvol; fi\n";
}

// fish

std::string fish_quoted(const std::string& text) {
  return "'" + replaced(replaced(text, "\\", "\\\\"), "'", "\\'") + "'";
}

std::string fish_values(const Values& values) {
  switch (values.kind) {
    case Values::Kind::kFiles:
    case Values::Kind::kSurfaces:
      return " -r -F";
    case Values::Kind::kDirectories:
      return " -x -a '(__fish_complete_directories)'";
    case Values::Kind::kWords:
      return " -x -a " + fish_quoted(joined(values.words, " "));
    case Values::Kind::kAny:
      return " -x";
    case Values::Kind::kNone:
      break;
  }
  return "";
}

std::string fish_option(const OptionEntry& option, const std::string& condition) {
  std::string text = "complete -c locvol -n " + condition;
  for (const std::string& name : option.names)
    text += name.starts_with("--") ? " -l " + name.substr(2) : " -s " + name.substr(1);
  return text + fish_values(option.values) + " -d " + fish_quoted(option.description) + "\n";
}

std::string fish_command(const CommandEntry& command) {
  const std::string condition = fish_quoted("__fish_seen_subcommand_from " + command.name);
  std::string text = fmt::format("complete -c locvol -n __fish_use_subcommand -f -a {} -d {}\n",
                                 command.name, fish_quoted(command.description));
  for (const OptionEntry& option : command.options) text += fish_option(option, condition);
  for (const OptionEntry& p : command.positionals) {
    const bool takes_files =
        p.values.kind == Values::Kind::kFiles || p.values.kind == Values::Kind::kSurfaces;
    text += fmt::format("complete -c locvol -n {}{}\n", condition,
                        takes_files ? " -F" : replaced(fish_values(p.values), " -x", " -f"));
  }
  return text;
}

std::string fish_script(const CLI::App& app, const std::vector<CommandEntry>& commands) {
  std::string text = "# Completion of locvol's command line in fish.\n";
  for (const OptionEntry& option : entry_of(app).options)
    text += fish_option(option, "__fish_use_subcommand");
  for (const CommandEntry& command : commands) text += fish_command(command);
  return text;
}

using Form = std::string (*)(const CLI::App&, const std::vector<CommandEntry>&);
constexpr std::array<std::pair<std::string_view, Form>, 4> kForms = {
    {{"man", man_page}, {"bash", bash_script}, {"zsh", zsh_script}, {"fish", fish_script}}};

Form form_named(std::string_view name) {
  for (const auto& [form, write] : kForms)
    if (form == name) return write;
  return nullptr;
}

}  // namespace

bool is_reference_form(std::string_view form) { return form_named(form) != nullptr; }

std::string reference(const CLI::App& app, std::string_view form) {
  return form_named(form)(app, commands_of(app));
}

}  // namespace locvol
