// SPDX-License-Identifier: Apache-2.0
#include "filters/formula/formula.h"

#include <muParser.h>

#include <algorithm>
#include <cmath>

#include "base/closest.h"

namespace gobo {
inline namespace filters {

namespace {

constexpr std::string_view kLetters = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_ .+-*/^()<>=!&|?:,";
constexpr std::string_view kObject = "object", kCaster = "caster";
static_assert(kObject.size() == kCaster.size());

double clampTo(double x, double low, double high) { return std::min(std::max(x, low), high); }
double mixOf(double a, double b, double t) { return a + (b - a) * t; }
double smoothstepOf(double low, double high, double x) {
  const double t = low == high ? (x < low ? 0.0 : 1.0) : clampTo((x - low) / (high - low), 0.0, 1.0);
  return t * t * (3.0 - 2.0 * t);
}

std::string objectName(size_t k) { return "object_" + std::to_string(k) + "_"; }

/// Puts names in the place of object("...") and caster("..."). Errors: what is wrong with one, as text.
std::string withoutObjects(const std::string& text, std::string& code, std::vector<Formula::Object>& objects) {
  for (size_t at = 0; at < text.size();) {
    const bool begins = at == 0 || (!std::isalnum(static_cast<unsigned char>(text[at - 1])) && text[at - 1] != '_');
    size_t open = at + kObject.size();
    const bool caster = text.compare(at, kCaster.size(), kCaster) == 0;
    if (!begins || (!caster && text.compare(at, kObject.size(), kObject) != 0)) {
      code += text[at++];
      continue;
    }
    while (open < text.size() && text[open] == ' ') ++open;
    const size_t first = open + 2, quote = first <= text.size() ? text.find('"', first) : std::string::npos;
    if (text.compare(open, 2, "(\"") != 0 || quote == std::string::npos || quote + 1 >= text.size() || text[quote + 1] != ')')
      return "at character " + std::to_string(at + 1) + ": an object is named as object(\"NAME\") or caster(\"NAME\")";
    const Formula::Object named{text.substr(first, quote - first), caster};
    const size_t k = size_t(std::find(objects.begin(), objects.end(), named) - objects.begin());
    if (k == objects.size()) objects.push_back(named);
    code += objectName(k);
    at = quote + 2;
  }
  return {};
}

/// An equals sign that assigns; npos: there is none.
size_t assignment(const std::string& code) {
  for (size_t i = 0; i < code.size(); ++i) {
    if (code[i] != '=') continue;
    const char before = i > 0 ? code[i - 1] : ' ';
    if (before == '<' || before == '>' || before == '!') continue;
    if (i + 1 < code.size() && code[i + 1] == '=') {
      ++i;
      continue;
    }
    return i;
  }
  return std::string::npos;
}

}  // namespace

struct Formula::Evaluator::Impl {
  mu::Parser parser;
  std::vector<double> names, objects;
};

Formula::Evaluator::Evaluator(const Formula& formula) : impl_(std::make_unique<Impl>()) {
  mu::Parser& p = impl_->parser;
  impl_->names.resize(formula.names_.size());
  impl_->objects.resize(formula.objects_.size());
  for (size_t k = 0; k < formula.names_.size(); ++k) p.DefineVar(formula.names_[k], &impl_->names[k]);
  for (size_t k = 0; k < formula.objects_.size(); ++k) p.DefineVar(objectName(k), &impl_->objects[k]);
  p.DefineConst("pi", 3.14159265358979323846);
  p.DefineFun("clamp", clampTo);
  p.DefineFun("mix", mixOf);
  p.DefineFun("smoothstep", smoothstepOf);
  p.SetExpr(formula.code_);
}
Formula::Evaluator::~Evaluator() = default;
Formula::Evaluator::Evaluator(Evaluator&&) noexcept = default;
double& Formula::Evaluator::name(size_t k) { return impl_->names[k]; }
double& Formula::Evaluator::object(size_t k) { return impl_->objects[k]; }
double Formula::Evaluator::operator()() const { return impl_->parser.Eval(); }

Result<Formula> Formula::parse(const std::string& text, std::span<const std::string_view> names, const std::string& field) {
  const auto refuse = [&](const std::string& what) { return invalidArgument(field + ": " + what, field); };
  if (text.empty()) return refuse("is empty");
  if (text.size() > kMostFormula) return refuse("has " + std::to_string(text.size()) + " characters: must be at most " + std::to_string(kMostFormula));
  Formula f;
  f.text_ = text;
  if (const std::string wrong = withoutObjects(text, f.code_, f.objects_); !wrong.empty()) return refuse(wrong);
  if (const size_t at = f.code_.find_first_not_of(kLetters); at != std::string::npos)
    return refuse("has a character that is part of no formula, after '" + f.code_.substr(0, at) + "'");
  if (const size_t at = assignment(f.code_); at != std::string::npos) return refuse("assigns, after '" + f.code_.substr(0, at) + "': equality is ==");
  f.names_.assign(names.begin(), names.end());
  f.reads_.assign(names.size(), false);
  try {
    const Evaluator trial(f);
    trial();
    if (trial.impl_->parser.GetNumResults() != 1) return refuse("is a list of " + std::to_string(trial.impl_->parser.GetNumResults()) + " values: must be one");
    const auto& used = trial.impl_->parser.GetUsedVar();
    for (size_t k = 0; k < names.size(); ++k) f.reads_[k] = used.count(f.names_[k]) != 0;
  } catch (const mu::Parser::exception_type& e) {
    std::string what = e.GetMsg();
    std::vector<std::string> known = f.names_;
    if (const std::string token = e.GetToken(); !token.empty() && std::isalpha(static_cast<unsigned char>(token[0]))) {
      what += didYouMean(token, known) + " (names: ";
      for (size_t k = 0; k < known.size(); ++k) what += (k ? ", " : "") + known[k];
      what += known.empty() ? "none)" : ", object(\"NAME\"), caster(\"NAME\"))";
    }
    return refuse(what);
  }
  return f;
}

}  // namespace filters
}  // namespace gobo
