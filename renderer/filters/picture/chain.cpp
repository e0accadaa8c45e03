// SPDX-License-Identifier: Apache-2.0
#include "filters/picture/chain.h"

#include "gobo/v1/options.pb.h"

namespace gobo {
inline namespace filters {

std::string filteredTerm(const v1::PictureFilter& filter) { return filter.term().empty() ? "beauty" : filter.term(); }

Chain chainOf(const v1::RenderRequest& request, std::string_view term, int last) {
  Chain chain;
  for (int k = 0; k < request.filters_size() && k <= last; ++k) {
    const v1::PictureFilter& f = request.filters(k);
    const PictureFilterEntry* entry = findPictureFilter(f.filter_case());
    if (entry && !entry->identity(f) && filteredTerm(f) == term) chain.push_back({k, entry, &f});
  }
  return chain;
}

bool anyFilter(const v1::RenderRequest& request) {
  for (const v1::PictureFilter& f : request.filters())
    if (const PictureFilterEntry* entry = findPictureFilter(f.filter_case()); entry && !entry->identity(f)) return true;
  return false;
}

namespace {
std::string chainLabel(int index, const PictureFilterEntry& entry, const std::string& term) {
  return "filters[" + std::to_string(index) + "] " + entry.name + ":" + term;
}
}  // namespace

void pruneIdentities(Graph& graph, const v1::RenderRequest& request) {
  for (int k = 0; k < request.filters_size(); ++k) {
    const v1::PictureFilter& f = request.filters(k);
    const PictureFilterEntry* entry = findPictureFilter(f.filter_case());
    if (!entry) continue;
    if (const char* why = entry->identity(f)) graph.prune(chainLabel(k, *entry, filteredTerm(f)), std::string("changes nothing: ") + why);
  }
}

const ChainLink* findNonlinear(const Chain& chain, const PictureShape& shape) {
  for (const ChainLink& link : chain)
    if (!link.entry->make(shape, *link.filter)->traits().linearPerGroup) return &link;
  return nullptr;
}

NodeId addChain(Graph& graph, NodeId in, const Chain& chain, const PictureShape& shape, const std::string& term) {
  for (const ChainLink& link : chain) {
    GraphNode n{link.entry->make(shape, *link.filter), {in}, {}, chainLabel(link.index, *link.entry, term)};
    n.approximate = "a filter of the request in the place of the light as it is";
    in = graph.add(std::move(n));
  }
  return in;
}

void scaleFilters(v1::RenderRequest& request, double scale) {
  using Field = google::protobuf::FieldDescriptor;
  for (v1::PictureFilter& f : *request.mutable_filters()) {
    const Field* chosen = f.GetReflection()->GetOneofFieldDescriptor(f, f.GetDescriptor()->FindOneofByName("filter"));
    if (!chosen) continue;
    google::protobuf::Message& m = *f.GetReflection()->MutableMessage(&f, chosen);
    for (int i = 0; i < m.GetDescriptor()->field_count(); ++i) {
      const Field* field = m.GetDescriptor()->field(i);
      const v1::Number& range = field->options().GetExtension(v1::number);
      if (field->options().GetExtension(v1::unit) != "px" || !m.GetReflection()->HasField(m, field)) continue;
      const auto within = [&](double v) { return std::clamp(v, range.min(), range.max()); };
      if (field->cpp_type() == Field::CPPTYPE_DOUBLE) m.GetReflection()->SetDouble(&m, field, within(scale * m.GetReflection()->GetDouble(m, field)));
      if (field->cpp_type() == Field::CPPTYPE_UINT32)
        m.GetReflection()->SetUInt32(&m, field, uint32_t(within(std::round(scale * m.GetReflection()->GetUInt32(m, field)))));
    }
  }
}

}  // namespace filters
}  // namespace gobo
