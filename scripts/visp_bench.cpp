// Times one template tracker of ViSP on a folder of frames with groundtruth.txt, and prints two lines of JSON as
// `mtf-eval bench --against` reads them: one with the stop rule of mtf-eval, one with ten iterations in every frame.
//
//   visp_bench FOLDER TRACKER|blur WARP LIKE BUILD [STEP] [PASSES]
//
// LIKE is the tracker of mtf-eval that does the same; BUILD says which library this is. bench_peers.sh builds it.
//
// Only track() is timed, the least over the passes for each frame; a value of every cache line of the frame is read before.
// ViSP's own blur is off, because the frames are as all programs shall see them. Time is that of the processor, which is no
// more than that of the clock and far less on a machine with other work to do.
//
// ViSP stops by another rule: when the mean squared step of the corners changes by less than a fraction of its first value. So
// that both do the same work, each frame is first tracked with 1, 2, 3, ... iterations from the same start, untimed, until
// the corners move by as little as makes mtf-eval stop. That number of iterations is then timed.
#include <visp3/core/vpConfig.h>
#include <visp3/core/vpImage.h>
#include <visp3/core/vpImageFilter.h>
#include <visp3/io/vpImageIo.h>
#include <visp3/tt/vpTemplateTrackerSSDESM.h>
#include <visp3/tt/vpTemplateTrackerSSDForwardAdditional.h>
#include <visp3/tt/vpTemplateTrackerSSDForwardCompositional.h>
#include <visp3/tt/vpTemplateTrackerSSDInverseCompositional.h>
#include <visp3/tt/vpTemplateTrackerWarpHomography.h>
#include <visp3/tt/vpTemplateTrackerWarpHomographySL3.h>
#include <visp3/tt/vpTemplateTrackerZNCCInverseCompositional.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <ctime>
#include <exception>
#include <fstream>
#include <functional>
#include <iostream>
#include <limits>
#include <map>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#ifdef ENABLE_VISP_NAMESPACE
using namespace VISP_NAMESPACE_NAME;
#endif

using Corners = std::array<double, 8>; // x and y of UL, UR, LR, LL
using Gray = vpImage<unsigned char>;
using WarpPtr = std::unique_ptr<vpTemplateTrackerWarp>;
using TrackerPtr = std::unique_ptr<vpTemplateTracker>;

namespace {

double processor_seconds()
{
  timespec time;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return time.tv_sec + 1e-9 * time.tv_nsec;
}

struct Sequence {
  std::vector<Gray> frames;
  std::vector<Corners> truth;
};

Sequence load(const std::string &folder)
{
  std::ifstream file(folder + "/groundtruth.txt");
  Sequence sequence;
  std::string line;
  while (std::getline(file, line)) {
    std::istringstream fields(line);
    std::string name;
    Corners corners;
    fields >> name;
    for (double &c : corners) {
      fields >> c;
    }
    if (!fields) {
      continue; // the header
    }
    Gray frame;
    vpImageIo::read(frame, folder + "/" + name);
    sequence.frames.push_back(frame);
    sequence.truth.push_back(corners);
  }
  if (sequence.frames.size() < 2) {
    throw std::runtime_error("no frames with ground truth in " + folder);
  }
  return sequence;
}

// The object as two triangles that share its diagonal from UL to LR.
std::vector<vpImagePoint> triangles(const Corners &c)
{
  std::vector<vpImagePoint> points;
  for (int corner : { 0, 1, 2, 0, 2, 3 }) {
    points.emplace_back(c[2 * corner + 1], c[2 * corner]); // row, column
  }
  return points;
}

Corners corners(vpTemplateTracker &tracker, vpTemplateTrackerWarp &warp)
{
  vpTemplateTrackerZone reference = tracker.getZoneRef(), now;
  warp.warpZone(reference, tracker.getp(), now);
  vpTemplateTrackerTriangle upper, lower;
  now.getTriangle(0, upper);
  now.getTriangle(1, lower);
  std::vector<vpImagePoint> a, b;
  upper.getCorners(a);
  lower.getCorners(b);
  return { a[0].get_u(), a[0].get_v(), a[1].get_u(), a[1].get_v(), a[2].get_u(), a[2].get_v(), b[2].get_u(), b[2].get_v() };
}

double squared_distance(const Corners &a, const Corners &b)
{
  double sum = 0;
  for (size_t i = 0; i < a.size(); i++) {
    sum += (a[i] - b[i]) * (a[i] - b[i]);
  }
  return sum;
}

template <class T> TrackerPtr make(vpTemplateTrackerWarp *warp) { return TrackerPtr(new T(warp)); }

const std::map<std::string, std::function<TrackerPtr(vpTemplateTrackerWarp *)>> TRACKERS = {
  { "SSDESM", make<vpTemplateTrackerSSDESM> },
  { "SSDForwardAdditional", make<vpTemplateTrackerSSDForwardAdditional> },
  { "SSDForwardCompositional", make<vpTemplateTrackerSSDForwardCompositional> },
  { "SSDInverseCompositional", make<vpTemplateTrackerSSDInverseCompositional> },
  { "ZNCCInverseCompositional", make<vpTemplateTrackerZNCCInverseCompositional> },
};

WarpPtr make_warp(const std::string &name)
{
  if (name == "Homography") {
    return WarpPtr(new vpTemplateTrackerWarpHomography);
  }
  if (name == "HomographySL3") {
    return WarpPtr(new vpTemplateTrackerWarpHomographySL3);
  }
  throw std::runtime_error("unknown warp " + name);
}

double quantile(const std::vector<double> &sorted, double q)
{
  return sorted[static_cast<size_t>(std::lround(q * (sorted.size() - 1)))];
}

// As `max_iters` and `epsilon` of mtf-eval.
const unsigned int MOST_ITERATIONS = 30;
const double STILL = 1e-4; // px^2, summed over the eight coordinates of the corners
const unsigned int FIXED_ITERATIONS = 10;

// The number of iterations from where `tracker` is until its corners hardly move. Leaves it there.
unsigned int iterations_to_stop(vpTemplateTracker &tracker, vpTemplateTrackerWarp &warp, const Gray &frame)
{
  const vpColVector start = tracker.getp();
  Corners before = corners(tracker, warp);
  for (unsigned int n = 1; n < MOST_ITERATIONS; n++) {
    tracker.setp(start);
    tracker.setIterationMax(n);
    tracker.track(frame);
    const Corners after = corners(tracker, warp);
    tracker.setp(start);
    if (squared_distance(before, after) < STILL) {
      return n;
    }
    before = after;
  }
  return MOST_ITERATIONS;
}

// Reads a value of every cache line.
void touch(const Gray &frame)
{
  unsigned int sum = 0;
  for (unsigned int i = 0; i < frame.getSize(); i += 64) {
    sum += frame.bitmap[i];
  }
  volatile unsigned int kept = sum;
  (void)kept;
}

struct Bench {
  const Sequence &sequence;
  std::string tracker, warp, like, build;
  int step, passes;
};

// Times every frame with a fixed number of iterations or with as many as the stop rule found in the pass that warms up.
int measure(const Bench &bench, bool fixed)
{
  const Sequence &sequence = bench.sequence;
  const size_t updates = sequence.frames.size() - 1;
  std::vector<unsigned int> iterations(updates, FIXED_ITERATIONS);
  std::vector<double> seconds(updates, std::numeric_limits<double>::infinity()), errors(updates);
  double steps = 0;
  size_t done = 0;
  for (int pass = 0; pass <= bench.passes; pass++) { // the first one warms up
    const WarpPtr warp = make_warp(bench.warp);
    const TrackerPtr tracker = TRACKERS.at(bench.tracker)(warp.get());
    tracker->setSampling(bench.step, bench.step);
    tracker->setThresholdResidualDifference(0); // no stop of its own
    tracker->setLambda(0.001);
    tracker->setBlur(false);
    tracker->initFromPoints(sequence.frames[0], triangles(sequence.truth[0]), false);
    std::fill(errors.begin(), errors.end(), std::numeric_limits<double>::infinity());
    steps = 0;
    done = 0;
    for (size_t i = 1; i <= updates; i++) {
      const Gray &frame = sequence.frames[i];
      try {
        if (pass == 0 && !fixed) {
          iterations[i - 1] = iterations_to_stop(*tracker, *warp, frame);
        }
        tracker->setIterationMax(iterations[i - 1]);
        touch(frame);
        const double begin = processor_seconds();
        tracker->track(frame);
        const double time = processor_seconds() - begin;
        if (pass > 0) {
          seconds[i - 1] = std::min(seconds[i - 1], time);
        }
        done++;
        steps += tracker->getNbIteration();
        const double error = std::sqrt(squared_distance(corners(*tracker, *warp), sequence.truth[i]) / 4);
        if (std::isfinite(error)) {
          errors[i - 1] = error;
        }
      }
      catch (const std::exception &e) { // it has lost the object: the rest are failures
        std::cerr << bench.tracker << ", frame " << i << ": " << e.what() << "\n";
        break;
      }
    }
  }
  if (done == 0 || steps == 0) {
    return 1; // what went wrong has been said
  }
  const auto good = std::count_if(errors.begin(), errors.end(), [](double e) { return e <= 5; });
  std::sort(errors.begin(), errors.end());
  seconds.resize(done);
  double total = 0;
  for (double s : seconds) {
    total += s;
  }
  std::sort(seconds.begin(), seconds.end());
  std::cout << "{\"tracker\": \"" << bench.like << (fixed ? "{epsilon=0,max_iters=10}" : "") << "\", \"program\": \"ViSP "
            << VISP_VERSION_MAJOR << "." << VISP_VERSION_MINOR << " " << bench.build << " " << bench.tracker << "\", \"frames\": " << done << ", \"iterations\": " << steps / done
            << ", \"us_per_iteration\": " << 1e6 * total / steps << ", \"us_per_frame\": " << 1e6 * total / done
            << ", \"us_median\": " << 1e6 * quantile(seconds, 0.5) << ", \"us_p95\": " << 1e6 * quantile(seconds, 0.95)
            << ", \"fps\": " << done / total << ", \"sr_5\": " << double(good) / updates;
  const double median = quantile(errors, 0.5);
  if (std::isfinite(median)) {
    std::cout << ", \"al_median\": " << median;
  }
  std::cout << "}" << std::endl;
  return 0;
}

// What a Gaussian of 5x5 costs here, which is not in any time above.
void blur(const Bench &bench)
{
  double least = std::numeric_limits<double>::infinity();
  vpImage<double> filtered;
  for (const Gray &frame : bench.sequence.frames) {
    touch(frame);
    const double begin = processor_seconds();
    vpImageFilter::gaussianBlur(frame, filtered, 5, 3.);
    least = std::min(least, processor_seconds() - begin);
  }
  std::cerr << "before the updates, a frame: ViSP (" << bench.build << ") filter 5x5 " << std::lround(1e6 * least) << " us\n";
}

int run(const std::vector<std::string> &args)
{
  if (args.size() < 5) {
    std::cerr << "usage: visp_bench FOLDER TRACKER|blur WARP LIKE BUILD [STEP] [PASSES]\n";
    return 2;
  }
  auto number = [&](size_t i, int otherwise) { return args.size() > i ? std::stoi(args[i]) : otherwise; };
  const Sequence sequence = load(args[0]);
  const Bench bench{ sequence, args[1], args[2], args[3], args[4], number(5, 4), number(6, 5) };
  if (bench.tracker == "blur") {
    blur(bench);
    return 0;
  }
  const int stopped = measure(bench, false);
  return measure(bench, true) | stopped;
}

} // namespace

int main(int argc, char **argv)
{
  try {
    return run(std::vector<std::string>(argv + 1, argv + argc));
  }
  catch (const std::exception &e) {
    std::cerr << "visp_bench: " << e.what() << "\n";
    return 2;
  }
}
