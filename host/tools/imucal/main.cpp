// SPDX-License-Identifier: MIT
// imucal: the one command.  `imucal dp …` starts the program dp of the same folder (or of libexec/imucal),
// `imucal import …` the Python package.  A log of another program (PX4, ArduPilot, ROS, …) among the
// arguments of a program that reads logs is imported first.
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>

#include "base/error.h"
#include "imucal/foreign.h"
#include "imucal/places.h"

namespace fs = std::filesystem;
using namespace imucal;

namespace {

enum class Kind { kProgram, kPython };
struct Subcommand {
  const char* name;
  Kind kind;
  bool reads_logs;
  const char* help;
};
constexpr Subcommand kSubcommands[] = {
    {"look", Kind::kPython, false, "one page and ten lines about any log: the first thing to do with it"},
    {"import", Kind::kPython, false, "a log of PX4, ArduPilot, ROS, MATLAB, CSV … into an imucal log"},
    {"export", Kind::kPython, false, "a table or model for PX4, ArduPilot, C, Kalibr, ROS, MATLAB, a datasheet"},
    {"check", Kind::kPython, false, "is this file one of ours, and valid?"},
    {"example", Kind::kPython, false, "a folder with a model, a profile, logs of a faulty sensor and a script"},
    {"report", Kind::kPython, false, "the result of diagnose as one HTML page"},
    {"plot", Kind::kPython, false, "a picture of a table, or of the result of calibrate fit, dp, errormodel, profile"},
    {"calibrate", Kind::kProgram, true, "talk to the IMU: run, record, flash, verify …; offline: fit"},
    {"dp", Kind::kProgram, true, "Allan deviation and Direct Predictor of logs"},
    {"errormodel", Kind::kProgram, true, "expect, fit, check, sensitivity, separation"},
    {"profile", Kind::kProgram, false, "temperature profiles: error, bound, optimize"},
    {"montecarlo", Kind::kProgram, false, "empirical against predicted calibration error"},
    {"gyrosim", Kind::kProgram, true, "simulate chamber and gyros: log, serve, replay"},
    {"diagnose", Kind::kProgram, true, "what the error model leaves out: where, which effect, how much"},
};

void print_help() {
  std::puts("imucal: static thermal calibration of inertial sensors\n\nusage: imucal SUBCOMMAND ...\n");
  for (const Subcommand& s : kSubcommands) std::printf("  %-11s %s\n", s.name, s.help);
  std::puts("\n'imucal SUBCOMMAND --help' tells more.  Logs of PX4, ArduPilot, ROS, MATLAB and Parquet may stand "
            "where a log is\n"
            "expected; they are imported on the way.\n"
            "Exit status: 0 done; 1 done, the answer is negative; 2 usage; 3 bad input data; 4 device or link; "
            "130 Ctrl-C.");
}

const Subcommand* find_subcommand(const std::string& name) {
  for (const Subcommand& s : kSubcommands)
    if (name == s.name) return &s;
  return nullptr;
}

[[noreturn]] void become(const std::vector<std::string>& command) {
  std::vector<char*> argv;
  for (const std::string& word : command) argv.push_back(const_cast<char*>(word.c_str()));
  argv.push_back(nullptr);
  ::execvp(argv[0], argv.data());
  std::fprintf(stderr, "imucal: cannot start %s: %s\n", argv[0], std::strerror(errno));
  std::_Exit(static_cast<int>(Exit::kUsage));
}

// While a scratch folder is there a signal ends the child alone: this program takes the folder away and ends after it.
class PassedOn {
public:
  PassedOn() {
    struct sigaction action {};
    action.sa_flags = SA_SIGINFO;
    action.sa_sigaction = [](int signal, siginfo_t* info, void*) {
      caught_ = signal;
      // A terminal sends it to the child too, whom a second one would kill.
      if (info->si_code <= 0 && child_ > 0) ::kill(child_, signal);
    };
    for (const int signal : kSignals) {
      struct sigaction before {};
      if (::sigaction(signal, nullptr, &before) == 0 && before.sa_handler == SIG_DFL) {
        ::sigaction(signal, &action, nullptr);
        sigaddset(&taken_, signal);
      }
    }
  }
  PassedOn(const PassedOn&) = delete;
  PassedOn& operator=(const PassedOn&) = delete;

  static int caught() { return caught_; } // the signal; 0: none
  // A child in whom signals do what they did before; none may come in between.
  pid_t fork() {
    sigset_t before;
    sigprocmask(SIG_BLOCK, &taken_, &before);
    child_ = ::fork();
    if (child_ == 0)
      for (const int signal : kSignals)
        if (sigismember(&taken_, signal)) ::signal(signal, SIG_DFL);
    sigprocmask(SIG_SETMASK, &before, nullptr);
    return child_;
  }

private:
  static constexpr int kSignals[] = {SIGINT, SIGTERM, SIGHUP};
  static inline std::atomic<int> caught_{0};
  static inline std::atomic<pid_t> child_{0};
  sigset_t taken_ = {};
};

// Exit status of a child; 128 + signal where one ended it, as shells say it.
int run_child(PassedOn* signals, const std::vector<std::string>& command) {
  if (PassedOn::caught() != 0) return 128 + PassedOn::caught();
  const pid_t pid = signals->fork();
  if (pid < 0) throw usage_error(std::string("cannot start a process: ") + std::strerror(errno));
  if (pid == 0) become(command);
  int status = 0;
  while (::waitpid(pid, &status, 0) < 0 && errno == EINTR) {
  }
  return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

std::vector<std::string> python_command(const Places& places, const std::string& subcommand) {
  if (const auto package = find_package(places)) {
    const char* before = std::getenv("PYTHONPATH");
    const std::string path = package->string() + (before && *before ? std::string(":") + before : "");
    ::setenv("PYTHONPATH", path.c_str(), 1);
  }
  ::setenv("IMUCAL_BIN", places.bin.c_str(), 1);
  return {find_python(places), "-m", "imucal", subcommand};
}

// A folder that goes when the command is done.
class Scratch {
public:
  Scratch() {
    std::string name = (fs::temp_directory_path() / "imucal-XXXXXX").string();
    if (!::mkdtemp(name.data())) throw usage_error("cannot make a folder in " + fs::temp_directory_path().string());
    path_ = name;
  }
  ~Scratch() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;
  const fs::path& path() const { return path_; }

private:
  fs::path path_;
};

// The program on imported copies of its foreign logs.  Allan deviations need no temperature: what does, says
// so.
int run_on_imported(const Places& places, const std::string& program, std::vector<std::string> arguments) {
  PassedOn signals;
  const Scratch scratch;
  ::setenv("IMUCAL_IMPORTED_IN", scratch.path().c_str(), 1); // messages name the user's file (io/input.cpp)
  int n = 0;
  for (std::string& argument : arguments) {
    const bool follows_option =
        &argument != &arguments[0] && (*(&argument - 1) == "-o" || *(&argument - 1) == "--json");
    if (follows_option || foreign_format(argument).empty()) continue;
    const fs::path folder = scratch.path() / std::to_string(n++);
    fs::create_directory(folder);
    const fs::path source = fs::path(argument).filename();
    fs::create_symlink(fs::absolute(argument), folder / source); // the program must not write over it (io/input.cpp)
    const std::string log = (folder / (source.string() + ".csv")).string();
    std::vector<std::string> import = python_command(places, "import");
    import.insert(import.end(), {argument, "-o", log, "--without-temp", "--notes-only"});
    if (const int status = run_child(&signals, import)) return status;
    argument = log;
  }
  arguments.insert(arguments.begin(), program);
  return run_child(&signals, arguments);
}

int dispatch(const Places& places, const Subcommand& subcommand, std::vector<std::string> arguments) {
  if (subcommand.kind == Kind::kPython) {
    std::vector<std::string> command = python_command(places, subcommand.name);
    command.insert(command.end(), arguments.begin(), arguments.end());
    become(command);
  }
  const auto program = find_program(places, subcommand.name);
  if (!program)
    throw usage_error(std::string("the program ") + subcommand.name + " is neither in " + places.programs[0].string() +
                      " nor in " + places.programs[1].string() + "; run make (or install imucal again)");
  if (subcommand.reads_logs)
    for (const std::string& argument : arguments)
      if (!foreign_format(argument).empty()) return run_on_imported(places, program->string(), arguments);
  arguments.insert(arguments.begin(), program->string());
  become(arguments);
}

} // namespace

int main(int argc, char** argv) {
  const std::string name = argc > 1 ? argv[1] : "--help";
  if (name == "--help" || name == "-h" || name == "help")
    return print_help(), argc > 1 ? 0 : static_cast<int>(Exit::kUsage);
  if (name == "--version") return std::puts("imucal (imucal) " IMUCAL_VERSION), 0;
  try {
    const Subcommand* subcommand = find_subcommand(name);
    if (!subcommand) throw usage_error("no subcommand \"" + name + "\" (try imucal --help)");
    std::error_code error;
    const fs::path self = fs::canonical("/proc/self/exe", error);
    if (error)
      throw data_error("/proc/self/exe cannot be read (" + error.message() +
                       "): mount /proc, imucal finds its programs by it");
    return dispatch(places_of(self), *subcommand, {argv + 2, argv + argc});
  } catch (const Error& e) {
    std::fprintf(stderr, "imucal: %s\n", e.what());
    return static_cast<int>(e.exit());
  } catch (const std::exception& e) {
    std::fprintf(stderr, "imucal: internal error: %s\n", e.what());
    return static_cast<int>(Exit::kData);
  }
}
