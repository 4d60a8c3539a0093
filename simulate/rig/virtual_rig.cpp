// SPDX-License-Identifier: Apache-2.0
#include "simulate/rig/virtual_rig.h"

#include <bit>
#include <cmath>
#include <deque>
#include <map>

#include "core/base/rng.h"

namespace refield {

namespace {

using Nanoseconds = MonotonicClock::duration;

Nanoseconds to_nanoseconds(Seconds s) {
  return Nanoseconds(std::llround(s.count() * 1e9));
}

// The first instant at or after `t` that is a multiple of `period` plus `phase`.
TimePoint next_tick(TimePoint t, Nanoseconds period, Nanoseconds phase) {
  const auto past = t.time_since_epoch() - phase;
  const auto count = (past + period - Nanoseconds(1)) / period;
  return TimePoint(phase + period * std::max<Nanoseconds::rep>(count, 0));
}

std::uint64_t content_hash(const std::vector<std::uint8_t>& bytes) {  // FNV-1a, 64 bits
  std::uint64_t hash = 0xcbf29ce484222325ull;
  for (std::uint8_t byte : bytes) hash = (hash ^ byte) * 0x100000001b3ull;
  return hash;
}

// A pattern on the monitor, and the scene under it once a frame needs it.
struct Pattern {
  DriveImage drive;
  std::uint64_t hash = 0;
  Image scene;  // [height × width × 3], without ambient light or drift; empty until asked for
};
using PatternPointer = std::shared_ptr<Pattern>;

struct Flip {
  TimePoint time;
  PatternPointer pattern;
};

// A pattern's share of the light that an exposure gathers.
struct Share {
  PatternPointer pattern;
  double weight;
};

struct Settings {
  Seconds exposure;
  double gain;
  bool operator==(const Settings&) const = default;
};

struct ExposedFrame {
  TimePoint start;
  Settings acting;
  Settings stated;  // by the driver, which knows what was asked for
  std::uint64_t sequence;
  std::vector<Share> light;
  std::array<float, 3> gain_of_monitor;
  float room;  // room light, relative to the ambient image
  std::array<double, 3> jitter;
  std::uint64_t noise_key;
};

}  // namespace

struct VirtualRig::State {
  struct CameraFace final : Camera {
    State* rig;
    explicit CameraFace(State* r) : rig(r) {}
    CameraDescription describe() const override { return rig->describe_camera(); }
    TimePoint set_exposure(Seconds e, double g) override { return rig->set_exposure(e, g); }
    RawFrame next_frame(Seconds timeout) override { return rig->next_frame(timeout); }
  };
  struct MonitorFace final : Illuminator {
    State* rig;
    explicit MonitorFace(State* r) : rig(r) {}
    IlluminatorDescription describe() const override { return rig->describe_monitor(); }
    TimePoint show(const DriveImage& image) override { return rig->show(image); }
  };
  struct TriggerFace final : Trigger {
    State* rig;
    explicit TriggerFace(State* r) : rig(r) {}
    TimePoint fire() override { return rig->fire(); }
  };

  CameraFace camera{this};
  MonitorFace illuminator{this};
  TriggerFace trigger{this};

  ReflectanceField transport;
  Image ambient;
  MonitorModel monitor;
  SensorModel sensor;
  std::uint64_t seed;

  TimePoint now{};
  std::deque<Flip> flips;  // the pattern that light has settled on, then those still to come
  std::deque<ExposedFrame> queue;
  std::optional<TimePoint> trigger_edge;
  TimePoint camera_ready{};
  TimePoint last_flip{};
  Settings asked{{}, 1.0};
  std::deque<Settings> coming;  // what the frames within the control latency have, then what was asked for
  std::uint64_t sequence = 0;
  std::map<std::pair<double, double>, std::uint64_t> settled_frames;  // since the flip, by exposure and gain
  std::uint64_t unsettled_frames = 0;
  double done = 0.0;             // share of the capture that is over
  std::uint64_t repetition = 0;  // of the patterns shown
  Disturbances disturbances;
  std::function<TracedScene(const Disturbances::Move&)> scene_at;
  Disturbances::Move position;  // of the camera that `transport` is of

  State(ReflectanceField t, Image a, MonitorModel m, SensorModel s, std::uint64_t seed_)
      : transport(std::move(t)), ambient(std::move(a)), monitor(m), sensor(s), seed(seed_) {
    check_scene();
    asked.exposure = std::clamp(sensor.frame_interval, sensor.shortest_exposure, sensor.longest_exposure);
    coming.push_back(asked);
    const LightDomain& domain = transport.basis.domain;
    DriveImage black{domain.width, domain.height,
                     std::vector<std::uint8_t>(std::size_t{3} * domain.width * domain.height)};
    flips.push_back({TimePoint{}, pattern_of(std::move(black))});
    // The light of a monitor that has been black for long, and a queue full of frames of it.
    now = camera_ready =
        next_tick(TimePoint(to_nanoseconds(monitor.latency + monitor.settling)), period(), {});
    for (int i = 0; i < sensor.latency_frames; ++i) queue.push_back(expose_one());
  }

  void check_scene() {
    transport.output_from_primaries.setIdentity();
    if (ambient.empty()) ambient = Image(transport.width, transport.height, 3);
    if (ambient.width != transport.width || ambient.height != transport.height || ambient.channels != 3)
      throw InputError("virtual rig: the ambient image is ", shape_text(ambient), ", the transport has ",
                       transport.width, "×", transport.height,
                       " pixels; use the ambient image made together with the transport");
  }

  // Renders the scene from where the camera stands now.
  void follow_camera() {
    const Disturbances::Move camera_position = disturbances.position(done);
    if (camera_position.right_px == position.right_px && camera_position.down_px == position.down_px) return;
    const int width = transport.width, height = transport.height;
    const LightDomain domain = transport.basis.domain;
    transport = {};  // two of them need not fit into memory
    TracedScene scene = scene_at(camera_position);
    transport = std::move(scene.transport);
    ambient = std::move(scene.ambient);
    check_scene();
    if (transport.width != width || transport.height != height || transport.basis.domain != domain)
      throw InputError("virtual rig: the scene of the moved camera has another size");
    position = camera_position;
    for (Flip& flip : flips) flip.pattern->scene = {};
    for (ExposedFrame& frame : queue)
      for (Share& share_of_light : frame.light) share_of_light.pattern->scene = {};
  }

  Nanoseconds period() const { return to_nanoseconds(monitor.refresh_interval); }

  static PatternPointer pattern_of(DriveImage drive) {
    const std::uint64_t hash = content_hash(drive.levels);
    return std::make_shared<Pattern>(Pattern{std::move(drive), hash, {}});
  }

  // Share of a flip's light that is there at time t: 0 before the latency is over, 1 once settled, linear in
  // between.
  double risen(const Flip& flip, TimePoint t) const {
    const double since = Seconds(t - flip.time - to_nanoseconds(monitor.latency)).count();
    if (since < 0.0) return 0.0;
    return monitor.settling.count() > 0.0 ? std::min(1.0, since / monitor.settling.count()) : 1.0;
  }

  // Mean share of each pattern's light over [start, end]: pattern k fades in over those before it and is
  // faded over by those after it, so its share at an instant is r_k Π_{j>k} (1 − r_j).
  std::vector<Share> gathered(TimePoint start, TimePoint end) const {
    std::vector<TimePoint> breaks{start, end};
    for (const Flip& flip : flips)
      for (TimePoint t : {flip.time + to_nanoseconds(monitor.latency),
                          flip.time + to_nanoseconds(monitor.latency + monitor.settling)})
        if (t > start && t < end) breaks.push_back(t);
    std::ranges::sort(breaks);
    std::vector<double> weights(flips.size(), 0.0);
    const double span = std::max(1e-9, Seconds(end - start).count());
    // Three-point Gauss–Legendre: exact for the polynomials between two breaks while at most five flips
    // overlap.
    constexpr std::array<std::pair<double, double>, 3> rule{
        {{0.1127016653792583, 5.0 / 18.0}, {0.5, 8.0 / 18.0}, {0.8872983346207417, 5.0 / 18.0}}};
    for (std::size_t i = 0; i + 1 < breaks.size(); ++i) {
      const Seconds length = breaks[i + 1] - breaks[i];
      for (const auto& [node, weight] : rule) {
        const TimePoint t = breaks[i] + to_nanoseconds(length * node);
        double left = weight * length.count() / span;
        for (std::size_t k = flips.size(); k-- > 0;) {
          const double r = k == 0 ? 1.0 : risen(flips[k], t);
          weights[k] += left * r;
          left *= 1.0 - r;
        }
      }
    }
    std::vector<Share> shares;
    for (std::size_t k = 0; k < flips.size(); ++k)
      if (weights[k] > 0.0) shares.push_back({flips[k].pattern, weights[k]});
    return shares;
  }

  ExposedFrame expose_one() {
    const Nanoseconds half = period() / 2;
    const TimePoint start =
        trigger_edge ? *trigger_edge : next_tick(std::max(now, camera_ready), period(), half);
    trigger_edge.reset();
    const Settings acting = coming.front();
    if (coming.size() > 1) coming.pop_front();
    const TimePoint end = start + to_nanoseconds(sensor.true_exposure(acting.exposure));
    camera_ready = std::max(end, start + to_nanoseconds(sensor.frame_interval));
    now = std::max(now, end);
    while (flips.size() > 1 && risen(flips[1], start) >= 1.0) flips.pop_front();

    ExposedFrame frame{start, acting, asked, sequence++, gathered(start, end), {}, 1.0f, {}, 0};
    frame.room = static_cast<float>(disturbances.room(done));
    // All exposures of a photograph have the same jitter.
    Rng place(seed, std::bit_cast<std::uint64_t>(done), repetition);
    frame.jitter = sensor.jitter(place.next());
    const double backlight = monitor.backlight(start, end);
    for (int c = 0; c < 3; ++c)
      frame.gain_of_monitor[c] = static_cast<float>(backlight * monitor.gain(c, done));
    const bool settled = flips.size() == 1 && acting == asked;
    const std::uint64_t ordinal =
        settled ? settled_frames[{acting.exposure.count(), acting.gain}]++ : unsettled_frames++;
    Rng key(seed, settled, flips.back().pattern->hash, std::bit_cast<std::uint64_t>(acting.exposure.count()),
            std::bit_cast<std::uint64_t>(acting.gain), ordinal + (repetition << 32));
    frame.noise_key = key.next();
    return frame;
  }

  const Image& scene_under(Pattern& pattern) {
    if (pattern.scene.empty()) pattern.scene = transport.relight(monitor.emitted(pattern.drive));
    return pattern.scene;
  }

  Image gathered_light(const ExposedFrame& frame) {
    Image sum = scene_under(*frame.light[0].pattern);
    if (frame.light.size() > 1) {
      for (float& v : sum.values) v *= static_cast<float>(frame.light[0].weight);
      for (std::size_t k = 1; k < frame.light.size(); ++k) {
        const Image& scene = scene_under(*frame.light[k].pattern);
        for (std::size_t i = 0; i < sum.values.size(); ++i)
          sum.values[i] += static_cast<float>(frame.light[k].weight) * scene.values[i];
      }
    }
    for (std::size_t i = 0; i < sum.values.size(); ++i)
      sum.values[i] = sum.values[i] * frame.gain_of_monitor[i % 3] + frame.room * ambient.values[i];
    sum = sensor.mixed(std::move(sum));
    for (std::size_t i = 0; i < sum.values.size(); ++i)
      sum.values[i] *= static_cast<float>(frame.jitter[i % 3]);
    return sum;
  }

  CameraDescription describe_camera() const {
    return {"virtual camera", transport.width,          transport.height,        sensor.layout,
            sensor.bits,      sensor.shortest_exposure, sensor.longest_exposure, sensor.frame_interval};
  }

  TimePoint set_exposure(Seconds new_exposure, double new_gain) {
    const auto refuse = [](const std::string& what, double value, double low, double high) {
      throw InputError("virtual camera: ", what, " ", value, " lies outside ", low, " to ", high);
    };
    if (!(new_exposure >= sensor.shortest_exposure && new_exposure <= sensor.longest_exposure))
      refuse("an exposure in seconds of", new_exposure.count(), sensor.shortest_exposure.count(),
             sensor.longest_exposure.count());
    if (!(new_gain >= 1.0 && new_gain <= sensor.largest_gain))
      refuse("a gain of", new_gain, 1.0, sensor.largest_gain);
    // The frames within the latency have what was to act until now.
    const auto latency = static_cast<std::size_t>(sensor.control_latency_frames);
    const Settings last = coming.back();
    coming.resize(std::min(coming.size(), latency));
    while (coming.size() < latency) coming.push_back(last);
    asked = {new_exposure, new_gain};
    coming.push_back(asked);
    return now;
  }

  RawFrame next_frame(Seconds timeout) {
    follow_camera();
    const TimePoint began = now;
    queue.push_back(expose_one());
    if (const Seconds waited = now - began; waited > timeout) {
      queue.pop_back();  // lost: the next frame's sequence number will show the gap
      throw DeviceError("virtual camera", ETIMEDOUT, "no frame within ", timeout.count(),
                        " s; allow more time than the exposure takes");
    }
    const ExposedFrame frame = std::move(queue.front());
    queue.pop_front();
    return {transport.width,
            transport.height,
            sensor.layout,
            sensor.expose(gathered_light(frame), sensor.true_exposure(frame.acting.exposure),
                          frame.acting.gain, frame.noise_key),
            frame.start,
            frame.stated.exposure,
            frame.stated.gain,
            frame.sequence};
  }

  IlluminatorDescription describe_monitor() const {
    const LightDomain& domain = transport.basis.domain;
    return {"virtual monitor", domain.width, domain.height, monitor.latency, monitor.settling};
  }

  TimePoint show(const DriveImage& image) {
    const LightDomain& domain = transport.basis.domain;
    require_size(image, domain.width, domain.height, "virtual monitor");
    // Waiting for the frame in progress keeps the time from the flip to the next frame the same, whatever was
    // before.
    now = next_tick(std::max({now, camera_ready, last_flip + Nanoseconds(1)}), period(), {});
    last_flip = now;
    flips.push_back({now, pattern_of(image)});
    settled_frames.clear();
    unsettled_frames = 0;
    return now;
  }

  TimePoint fire() {
    now = next_tick(std::max(now, camera_ready), period(), {});
    trigger_edge = now;
    return now;
  }
};

VirtualRig::VirtualRig(ReflectanceField transport, Image ambient, MonitorModel monitor, SensorModel sensor,
                       std::uint64_t seed)
    : state_(std::make_unique<State>(std::move(transport), std::move(ambient), monitor, sensor, seed)) {}
VirtualRig::~VirtualRig() = default;
VirtualRig::VirtualRig(VirtualRig&&) noexcept = default;
VirtualRig& VirtualRig::operator=(VirtualRig&&) noexcept = default;

Camera& VirtualRig::camera() {
  return state_->camera;
}
Illuminator& VirtualRig::illuminator() {
  return state_->illuminator;
}
void VirtualRig::set_place(double done, std::uint32_t repetition) {
  state_->done = done;
  state_->repetition = repetition;
}
void VirtualRig::disturb(Disturbances disturbances,
                         std::function<TracedScene(const Disturbances::Move&)> scene_at) {
  if (!disturbances.moves.empty() && !scene_at)
    throw InputError("virtual rig: a camera that moves needs a function that traces the scene");
  state_->disturbances = std::move(disturbances);
  state_->scene_at = std::move(scene_at);
}
Trigger& VirtualRig::trigger() {
  return state_->trigger;
}

}  // namespace refield
