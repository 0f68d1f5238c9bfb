// SPDX-License-Identifier: MIT
// The command line of a program: a thin front of CLI11, whose templates are compiled once, here.
//
//   cli::App app("what it does", "name");
//   app.add_option("--order", order, "order of the polynomial")->check(cli::Range(0, 5))->capture_default_str();
//
// The variables live as long as the app; parsing (run_program in program.h) fills them.  A default that is captured is
// the value that the variable has at that moment.
#pragma once
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace CLI {
class App;
class Option;
} // namespace CLI

namespace imucal::cli {

// What an argument must be: the reason for a refusal, empty for none; and how --help names it.
struct Check {
  std::function<std::string(std::string&)> refuse;
  std::string description;
};
Check Range(double lo, double hi); // lo <= number <= hi
Check Range(int lo, int hi);
Check IsMember(std::vector<std::string> words);
extern const Check NonNegativeNumber, PositiveNumber;

// A file that the command writes.
struct Output {
  std::string option, path;
};

class Option {
public:
  explicit Option(CLI::Option* option) : option_(option) {}
  Option* required();
  Option* check(const Check& check);
  Option* type_name(const std::string& name);
  Option* group(const std::string& name);        // of --help; "": hidden
  Option* expected(int n);                       // arguments; negative: at least so many
  Option* allow_extra_args(bool allowed = true); // --axis a b as well as --axis a --axis b
  Option* capture_default_str();
  Option* writes(); // names a file that the command writes: run_program refuses an empty name, and one file named twice
  size_t count() const; // how often it was given

private:
  friend class App;
  CLI::Option* option_;
  bool writes_ = false;
};

class App {
public:
  App(const std::string& description, const std::string& name);
  explicit App(CLI::App* app); // a subcommand
  ~App();
  App(const App&) = delete;
  App& operator=(const App&) = delete;

  // Numbers are finite; whole numbers are decimal, also with zeros in front.
  Option* add_option(const std::string& name, double& value, const std::string& help);
  Option* add_option(const std::string& name, int& value, const std::string& help);
  Option* add_option(const std::string& name, unsigned& value, const std::string& help);
  Option* add_option(const std::string& name, uint64_t& value, const std::string& help);
  Option* add_option(const std::string& name, std::string& value, const std::string& help);
  Option* add_option(const std::string& name, std::vector<double>& values, const std::string& help);
  Option* add_option(const std::string& name, std::vector<std::string>& values, const std::string& help);
  // Called with the word that was given.
  Option* add_option(const std::string& name, const std::function<void(const std::string&)>& take,
                     const std::string& help);
  Option* add_flag(const std::string& name, bool& value, const std::string& help);
  // The name that an option had in an earlier version: works, stands in no --help, and not beside the option itself.
  Option* add_old_name(const std::string& name, double& value, const Option* option);

  App* add_subcommand(const std::string& name, const std::string& description);
  void require_subcommand(int n = 1);
  void fallthrough(bool allowed = true); // options that a subcommand does not know are the app's
  bool parsed() const;                   // this subcommand was given
  explicit operator bool() const { return parsed(); }
  std::vector<Output> outputs() const;       // those that were given, of subcommands too
  std::string chosen() const;                // name of the subcommand that was given; "": none
  CLI::App& behind() const { return *app_; } // for program.cpp

private:
  Option* keep(CLI::Option* option);
  std::unique_ptr<CLI::App> own_;
  CLI::App* app_;
  std::vector<std::unique_ptr<Option>> options_;
  std::vector<std::unique_ptr<App>> subcommands_;
};

} // namespace imucal::cli
