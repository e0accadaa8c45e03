// SPDX-License-Identifier: Apache-2.0
#include "fuzz/served/sequence.h"
#include "import/load.h"

#include <algorithm>
#include <set>
#include <thread>

#include "base/hash.h"
#include "base/utf8.h"
#include "fuzz/served/generic_call.h"
#include "fuzz/served/sequence_script.h"
#include "fuzz/served/small_daemon.h"
#include "gobo/v1/jobs.pb.h"
#include "gobo/v1/service.pb.h"
#include "request/request.h"
#include "server/encode.h"

namespace gobo::fuzz::sequence {
namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;
using google::protobuf::MethodDescriptor;

constexpr double kCallSeconds = 120;    // a call that needs them hangs: pictures are tiny, but machines are busy and code may be instrumented
constexpr double kWatchSeconds = 0.05;  // of a stream that lives as long as its client likes
constexpr double kSettleSeconds = 60;

bool isAdmin(const std::string& client) { return client == *std::rbegin(kClients); }

/// The texts of every field of this name, anywhere in the message.
void collect(const Message& m, const std::string& name, std::set<std::string>& out) {
  std::vector<const FieldDescriptor*> fields;
  const auto& r = *m.GetReflection();
  r.ListFields(m, &fields);
  for (const FieldDescriptor* f : fields) {
    if (f->cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE) {
      for (int k = 0; k < (f->is_repeated() ? r.FieldSize(m, f) : 1); ++k)
        collect(f->is_repeated() ? r.GetRepeatedMessage(m, f, k) : r.GetMessage(m, f), name, out);
    } else if (f->name() == name && f->cpp_type() == FieldDescriptor::CPPTYPE_STRING && !f->is_repeated()) out.insert(r.GetString(m, f));
  }
}

/// The last reply of a render's stream with the bytes of its pictures; null where there is none.
struct Picture {
  const v1::RenderReply* reply = nullptr;
  std::vector<std::string> files;
};
Picture pictureOf(const CallAnswer& answer) {
  Picture out;
  for (const MessagePtr& m : answer.replies) {
    if (const auto* const whole = dynamic_cast<const v1::InlineReply*>(m.get())) return {&whole->reply(), {whole->images().begin(), whole->images().end()}};
    const auto* const event = dynamic_cast<const v1::RenderEvent*>(m.get());
    if (!event) return {};
    if (event->has_reply() || event->has_snapshot()) {
      out.reply = event->has_reply() ? &event->reply() : &event->snapshot();
      out.files.assign(size_t(out.reply->images_size()), "");
    }
    if (event->has_chunk() && event->chunk().image() < out.files.size()) out.files[event->chunk().image()] += event->chunk().data();
  }
  return out;
}

class Play {
 public:
  Outcome run(Bytes bytes) {
    const std::vector<ScriptedCall> calls = script(bytes);
    for (size_t i = 0; i < calls.size() && out_.broken.empty();) {
      size_t end = i + 1;
      while (end < calls.size() && calls[end].beside) ++end;
      if (end == i + 1) act(calls[i], true);
      else together({calls.begin() + std::ptrdiff_t(i), calls.begin() + std::ptrdiff_t(end)});
      i = end;
    }
    if (out_.broken.empty()) settle();
    for (const std::string& kind : kinds_) out_.said += kind + "\n";
    return out_;
  }

 private:
  /// A thread a client.
  void together(const std::vector<ScriptedCall>& calls) {
    std::vector<std::thread> threads;
    std::set<std::string> clients;
    for (const ScriptedCall& c : calls) clients.insert(c.client);
    for (const std::string& client : clients)
      threads.emplace_back([&, client] {
        for (const ScriptedCall& c : calls)
          if (c.client == client) act(c, false);
      });
    for (std::thread& t : threads) t.join();
  }

  void act(const ScriptedCall& c, bool alone) {
    const std::vector<MessagePtr> requests = requestsOf(c, daemon_.root(), learned_);
    CallOptions options;
    options.token = SmallDaemon::tokenOf(c.client);
    const bool endless = c.method->server_streaming() && c.method->service()->name() == "Jobs" && c.client != kStranger;
    options.seconds = endless ? kWatchSeconds : kCallSeconds;
    options.cancelAfter = c.cancelAfter();
    const CallAnswer answer = callMethod(daemon_.channel(), *c.method, requests, options);
    const std::string broken = wrong(c, requests, answer, endless);
    const std::lock_guard lock(mutex_);
    std::string kind = c.method->service()->name() + "." + c.method->name() + " " + std::to_string(int(answer.status.error_code())) +
                       (answer.cancelled ? " given up " : " ") + answer.status.error_message();
    std::replace(kind.begin(), kind.end(), '\n', ' ');
    kinds_.insert(std::move(kind));
    out_.accepted = out_.accepted || answer.status.ok();
    const std::string different = broken.empty() && alone && c.compared() && answer.status.ok() ? differs(answer) : "";
    if (out_.broken.empty() && !(broken + different).empty())
      out_.broken = c.client + " " + c.method->full_name() + ": " + broken + different + "\nanswer " + std::to_string(int(answer.status.error_code())) + " " +
                    answer.status.error_message() + "\nrequest " + messageToJson(*requests[0], false);
  }

  /// What is wrong with an answer.
  std::string wrong(const ScriptedCall& c, const std::vector<MessagePtr>& requests, const CallAnswer& answer, bool endless) {
    const grpc::Status& s = answer.status;
    const auto documented = documentedCodes();
    if (std::find(documented.begin(), documented.end(), s.error_code()) == documented.end()) return "an answer that the protocol does not have";
    if (!endless && answer.seconds >= kCallSeconds) return "no answer in time";
    if (!s.ok() && s.error_message().empty()) return "an error that says nothing";
    if (!isUtf8(s.error_message())) return "an error that is not UTF-8";
    if (s.error_code() == grpc::UNAVAILABLE && !daemon_.server().core().draining()) return "unavailable, though it does not drain";
    if (c.client == kStranger)
      return s.error_code() == grpc::UNAUTHENTICATED || answer.cancelled || s.error_code() == grpc::UNAVAILABLE ? "" : "a stranger is let in";
    if (s.error_code() == grpc::UNAUTHENTICATED) return "a token is not known";
    const Picture picture = pictureOf(answer);
    if (s.ok() && picture.reply)
      for (size_t i = 0; i < picture.files.size(); ++i) {
        const v1::ImageDescriptor& d = picture.reply->images(int(i));
        if (d.bytes() != picture.files[i].size() || d.digest() != hashBytes(picture.files[i].data(), picture.files[i].size()).hex())
          return "the bytes of " + d.output() + " are not those of its digest";
      }
    std::set<std::string> renders, sent;
    for (const MessagePtr& m : answer.replies) collect(*m, "render_id", renders);
    for (const std::string& id : renders)
      if (!id.empty()) learned_.add(c.client, id);
    return isAdmin(c.client) ? "" : told(c, requests, answer, renders);
  }

  /// What a client may not know, as far as it did not say so itself.
  std::string told(const ScriptedCall& c, const std::vector<MessagePtr>& requests, const CallAnswer& answer, const std::set<std::string>& own) {
    std::string asked, text = answer.status.error_message();
    std::set<std::string> used;
    for (const MessagePtr& m : requests) {
      asked += m->SerializeAsString();
      collect(*m, "render_id", used);
    }
    for (const MessagePtr& m : answer.replies) text += m->SerializeAsString();
    for (const std::string& id : used) {
      const std::string owner = learned_.ownerOf(id);
      if (answer.status.ok() && !owner.empty() && owner != c.client) return "a render of " + owner + " could be used";
    }
    const auto shown = [&](const std::string& what) { return text.find(what) != std::string::npos && asked.find(what) == std::string::npos; };
    for (const char* other : kClients)
      if (c.client != other && shown(privatePrefix(other))) return std::string("a scene of ") + other + " is shown";
    for (const std::string& id : learned_.othersThan(c.client))
      if (!own.count(id) && shown(id)) return "another client's render id is shown";
    for (const MessagePtr& m : answer.replies) {
      if (const std::string s = foreign(*m, c.client); !s.empty()) return s;
    }
    return {};
  }

  /// Scenes and jobs in a reply that are not this client's.
  std::string foreign(const Message& m, const std::string& client) {
    if (const auto* const info = dynamic_cast<const v1::SceneInfo*>(&m)) {
      const bool shared = std::any_of(info->share().begin(), info->share().end(), [&](const std::string& s) { return s == "*" || s == client; });
      if (!info->owner().empty() && info->owner() != client && !shared) return "scene \"" + info->id() + "\" of " + info->owner() + " is shown";
    }
    if (const auto* const job = dynamic_cast<const v1::Job*>(&m); job && job->has_spec() && job->spec().client() != client)
      return "job " + job->id() + " of " + job->spec().client() + " is shown";
    std::vector<const FieldDescriptor*> fields;
    const auto& r = *m.GetReflection();
    r.ListFields(m, &fields);
    for (const FieldDescriptor* f : fields)
      if (f->cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE)
        for (int k = 0; k < (f->is_repeated() ? r.FieldSize(m, f) : 1); ++k)
          if (const std::string s = foreign(f->is_repeated() ? r.GetRepeatedMessage(m, f, k) : r.GetMessage(m, f), client); !s.empty()) return s;
    return {};
  }

  /// A picture against that of an engine which has nothing yet, on one thread.
  std::string differs(const CallAnswer& answer) {
    const Picture picture = pictureOf(answer);
    if (!picture.reply) return {};
    const v1::RenderRequest& resolved = picture.reply->resolved();
    const auto scene = daemon_.server().core().engine.scene(resolved.scene());
    if (!scene.ok() || (*scene)->hash().hex() != resolved.scene_hash()) return {};  // a job may have taken it meanwhile
    EngineOptions o;
    o.loader = inProcessLoader();
    o.threads = 1;
    o.storeBytes = 64 << 20;
    const auto fresh = Engine::create(o);
    if (!fresh.ok()) return fresh.status().toString();
    RenderControl control;
    control.scene = *scene;
    Result<RenderResult> result = (*fresh)->render(resolved, control);
    if (!result.ok()) return "rendered by a fresh engine it is refused: " + result.status().toString();
    const auto files = encodeImages(*result);
    if (!files.ok()) return "of a fresh engine it cannot be encoded: " + files.status().toString();
    if (files->size() != picture.files.size()) return "a fresh engine gives another number of pictures";
    for (size_t i = 0; i < files->size(); ++i)
      if ((*files)[i].descriptor.digest() != picture.reply->images(int(i)).digest())
        return "a fresh engine gives another picture: " + (*files)[i].descriptor.output();
    return {};
  }

  template <typename Reply, typename Request>
  grpc::Status asRoot(const MethodDescriptor& method, const Request& request, Reply& reply) {
    std::vector<MessagePtr> requests;
    requests.push_back(std::make_unique<Request>(request));
    CallOptions options;
    options.token = SmallDaemon::tokenOf(*std::rbegin(kClients));
    options.seconds = kCallSeconds;
    CallAnswer answer = callMethod(daemon_.channel(), method, requests, options);
    if (answer.status.ok() && answer.replies.size() == 1) reply = dynamic_cast<const Reply&>(*answer.replies[0]);
    return answer.status;
  }
  static const MethodDescriptor& method(const std::string& name) {
    return *google::protobuf::DescriptorPool::generated_pool()->FindMethodByName("gobo.v1." + name);
  }

  /// Everything goes, and the books are balanced.
  void settle() {
    if (daemon_.server().core().draining()) return;
    v1::ListScenesReply scenes;
    v1::ListJobsReply jobs;
    const auto failed = [&](const char* what, const grpc::Status& s) {
      if (!s.ok() && out_.broken.empty()) out_.broken = std::string("at the end, ") + what + ": " + s.error_message();
      return !s.ok();
    };
    if (failed("listing jobs", asRoot(method("Jobs.List"), v1::ListJobsRequest(), jobs))) return;
    for (const v1::Job& job : jobs.jobs()) {
      v1::CancelJobRequest cancel;
      cancel.set_id(job.id());
      v1::DeleteJobRequest remove;
      remove.set_id(job.id());
      v1::Job cancelled;
      v1::DeleteJobReply removed;
      if (failed("cancelling a job", asRoot(method("Jobs.Cancel"), cancel, cancelled)) ||
          failed("deleting a job", asRoot(method("Jobs.Delete"), remove, removed)))
        return;
    }
    if (failed("listing scenes", asRoot(method("Scenes.List"), v1::ListScenesRequest(), scenes))) return;
    for (const v1::SceneInfo& scene : scenes.scenes()) {
      v1::UnloadSceneRequest unload;
      unload.set_scene(scene.id());
      v1::UnloadSceneReply unloaded;
      if (failed("unloading", asRoot(method("Scenes.Unload"), unload, unloaded))) return;
    }
    // A cancelled frame, and a call whose client has gone, end a little later than their answer.
    const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(kSettleSeconds);
    std::string held;
    do {
      v1::DropCachesRequest drop;
      drop.set_disk(true);
      drop.set_pinned(true);
      v1::DropCachesReply dropped;
      v1::StatusReply status;
      if (failed("dropping caches", asRoot(method("Admin.DropCaches"), drop, dropped)) ||
          failed("status", asRoot(method("Admin.GetStatus"), v1::StatusRequest(), status)))
        return;
      held = heldBy(status);
      if (held.empty()) return;
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    } while (std::chrono::steady_clock::now() < end);
    out_.broken = "when all is unloaded, " + held;
  }

  static std::string heldBy(const v1::StatusReply& s) {
    for (const v1::MemoryHolder& h : s.memory()) {
      const bool cache = h.name() == "posed scenes" || h.name() == "environments" || h.name() == "ray tracing" || h.name() == "remembered requests";
      if (h.bytes() > (cache ? h.limit() : 0)) return h.name() + " hold " + std::to_string(h.bytes()) + " bytes";
    }
    if (s.running() + s.queued() + s.loads() > 0)
      return std::to_string(s.running()) + " run, " + std::to_string(s.queued()) + " wait, " + std::to_string(s.loads()) + " load";
    return s.scenes() ? std::to_string(s.scenes()) + " scenes are loaded" : "";
  }

  SmallDaemon daemon_;
  LearnedIds learned_;
  std::mutex mutex_;
  Outcome out_;  // under mutex_, as is
  std::set<std::string> kinds_;
};

}  // namespace
}  // namespace gobo::fuzz::sequence

namespace gobo::fuzz {

std::span<const grpc::StatusCode> documentedCodes() {
  using namespace grpc;
  static constexpr StatusCode codes[] = {
      OK,          INVALID_ARGUMENT, OUT_OF_RANGE,      UNAUTHENTICATED,   PERMISSION_DENIED, FAILED_PRECONDITION, NOT_FOUND, ALREADY_EXISTS, UNIMPLEMENTED,
      UNAVAILABLE, CANCELLED,        DEADLINE_EXCEEDED, RESOURCE_EXHAUSTED};
  return codes;
}

Outcome trySequence(Bytes bytes) { return sequence::Play().run(bytes); }

}  // namespace gobo::fuzz
