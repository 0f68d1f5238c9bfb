// SPDX-License-Identifier: MIT
#include "cli/arguments.h"

#include <CLI/CLI.hpp>
#include <cmath>

namespace imucal::cli {

namespace {

CLI::Validator validator(const Check& check) {
  return {check.refuse, check.description};
}

Check from(const CLI::Validator& validator) {
  return {[validator](std::string& text) { return validator(text); }, validator.get_description()};
}

// strtod reads "nan" and "inf", and no comparison refuses the first.
std::string refuse_not_finite(const std::string& text) {
  double value = 0;
  if (!CLI::detail::lexical_cast(text, value) || std::isfinite(value)) return "";
  return "expected a finite number, found \"" + text + "\"";
}

// CLI11 would read "010" as 8.
std::string without_leading_zeros(const std::string& text) {
  const size_t first = text.find_first_not_of('0');
  if (text.empty() || text.find_first_not_of("0123456789") != std::string::npos) return text;
  return first == std::string::npos ? "0" : text.substr(first);
}

CLI::Option* decimal(CLI::Option* option) {
  return option->transform(without_leading_zeros, "");
}
CLI::Option* finite(CLI::Option* option) {
  return option->check(refuse_not_finite, "");
}

// A group that no help shows.  Options of the group "" would be hidden too, but from messages as well.
const char* const kOldNames = "old names";

class Help : public CLI::Formatter {
public:
  std::string make_group(std::string group, bool is_positional,
                         std::vector<const CLI::Option*> options) const override {
    return group == kOldNames ? "" : CLI::Formatter::make_group(group, is_positional, options);
  }
};

} // namespace

Check Range(double lo, double hi) {
  return from(CLI::Range(lo, hi));
}
Check Range(int lo, int hi) {
  return from(CLI::Range(lo, hi));
}
Check IsMember(std::vector<std::string> words) {
  return from(CLI::IsMember(std::move(words)));
}
const Check NonNegativeNumber = from(CLI::NonNegativeNumber), PositiveNumber = from(CLI::PositiveNumber);

Option* Option::required() {
  option_->required();
  return this;
}
Option* Option::check(const Check& check) {
  option_->check(validator(check));
  return this;
}
Option* Option::type_name(const std::string& name) {
  option_->type_name(name);
  return this;
}
Option* Option::group(const std::string& name) {
  option_->group(name);
  return this;
}
Option* Option::expected(int n) {
  option_->expected(n);
  return this;
}
Option* Option::allow_extra_args(bool allowed) {
  option_->allow_extra_args(allowed);
  return this;
}
Option* Option::capture_default_str() {
  option_->capture_default_str();
  return this;
}
Option* Option::writes() {
  writes_ = true;
  return this;
}
size_t Option::count() const {
  return option_->count();
}

App::App(const std::string& description, const std::string& name)
    : own_(std::make_unique<CLI::App>(description, name)), app_(own_.get()) {
  app_->formatter(std::make_shared<Help>());
}
App::App(CLI::App* app) : app_(app) {}
App::~App() = default;

Option* App::keep(CLI::Option* option) {
  options_.push_back(std::make_unique<Option>(option));
  return options_.back().get();
}

Option* App::add_option(const std::string& name, double& value, const std::string& help) {
  return keep(finite(app_->add_option(name, value, help)));
}
Option* App::add_option(const std::string& name, int& value, const std::string& help) {
  return keep(decimal(app_->add_option(name, value, help)));
}
Option* App::add_option(const std::string& name, unsigned& value, const std::string& help) {
  return keep(decimal(app_->add_option(name, value, help)));
}
Option* App::add_option(const std::string& name, uint64_t& value, const std::string& help) {
  return keep(decimal(app_->add_option(name, value, help)));
}
Option* App::add_option(const std::string& name, std::string& value, const std::string& help) {
  return keep(app_->add_option(name, value, help));
}
Option* App::add_option(const std::string& name, std::vector<double>& values, const std::string& help) {
  return keep(finite(app_->add_option(name, values, help)));
}
Option* App::add_option(const std::string& name, std::vector<std::string>& values, const std::string& help) {
  return keep(app_->add_option(name, values, help));
}
Option* App::add_option(const std::string& name, const std::function<void(const std::string&)>& take,
                        const std::string& help) {
  return keep(app_->add_option_function<std::string>(name, take, help));
}
Option* App::add_flag(const std::string& name, bool& value, const std::string& help) {
  return keep(app_->add_flag(name, value, help));
}
Option* App::add_old_name(const std::string& name, double& value, const Option* option) {
  CLI::Option* old = finite(app_->add_option(name, value))->group(kOldNames);
  const CLI::Option* now = option->option_;
  // Values are looked at when all words have been read.
  old->check([now](const std::string&) {
    return now->count() == 0 ? "" : "is the old name of " + now->get_name() + ", which is given too";
  });
  return keep(old);
}

App* App::add_subcommand(const std::string& name, const std::string& description) {
  subcommands_.push_back(std::make_unique<App>(app_->add_subcommand(name, description)));
  return subcommands_.back().get();
}
void App::require_subcommand(int n) {
  app_->require_subcommand(n);
}
void App::fallthrough(bool allowed) {
  app_->fallthrough(allowed);
}
bool App::parsed() const {
  return app_->parsed();
}
std::vector<Output> App::outputs() const {
  std::vector<Output> all;
  for (const auto& option : options_)
    if (option->writes_ && option->count() > 0)
      all.push_back({option->option_->get_name(), option->option_->results().front()});
  for (const auto& subcommand : subcommands_)
    for (const Output& output : subcommand->outputs()) all.push_back(output);
  return all;
}
std::string App::chosen() const {
  const auto given = app_->get_subcommands();
  return given.empty() ? "" : given.front()->get_name();
}

} // namespace imucal::cli
