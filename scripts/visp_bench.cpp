// Times one template tracker of ViSP on a folder of frames with groundtruth.txt, and prints a line of JSON as
// `mtf-eval bench --against` reads it. Only track() is timed, the least over the passes for each frame; ViSP's own blur of
// the whole image is off. Time is that of the processor, which is no more than that of the clock and far less on a machine
// with other work to do.
//
//   visp_bench FOLDER TRACKER WARP LIKE [STEP] [ITERATIONS] [PASSES]
//
// LIKE is the tracker of mtf-eval that does the same. See bench_peers.sh for how it is built.
#include <visp3/core/vpConfig.h>
#include <visp3/core/vpImage.h>
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

bool within(const Corners &a, const Corners &b, double pixels)
{
  double sum = 0;
  for (size_t i = 0; i < a.size(); i++) {
    sum += (a[i] - b[i]) * (a[i] - b[i]);
  }
  return std::sqrt(sum / 4) <= pixels; // false for what is not a number
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

int run(const std::vector<std::string> &args)
{
  if (args.size() < 4) {
    std::cerr << "usage: visp_bench FOLDER TRACKER WARP LIKE [STEP] [ITERATIONS] [PASSES]\n";
    return 2;
  }
  auto number = [&](size_t i, int otherwise) { return args.size() > i ? std::stoi(args[i]) : otherwise; };
  const int step = number(4, 4), iterations = number(5, 30), passes = number(6, 5);
  const Sequence sequence = load(args[0]);
  const size_t updates = sequence.frames.size() - 1;

  std::vector<double> seconds(updates, std::numeric_limits<double>::infinity());
  double steps = 0;
  size_t good = 0, done = 0;
  for (int pass = 0; pass <= passes; pass++) { // the first one warms up
    const WarpPtr warp = make_warp(args[2]);
    const TrackerPtr tracker = TRACKERS.at(args[1])(warp.get());
    tracker->setSampling(step, step);
    tracker->setIterationMax(iterations);
    tracker->setLambda(0.001);
    tracker->setBlur(false);
    tracker->initFromPoints(sequence.frames[0], triangles(sequence.truth[0]), false);
    steps = 0;
    good = done = 0;
    for (size_t i = 1; i <= updates; i++) {
      try {
        const double begin = processor_seconds();
        tracker->track(sequence.frames[i]);
        const double time = processor_seconds() - begin;
        if (pass > 0) {
          seconds[i - 1] = std::min(seconds[i - 1], time);
        }
        done++;
        steps += tracker->getNbIteration();
        good += within(corners(*tracker, *warp), sequence.truth[i], 5);
      }
      catch (const std::exception &e) { // it has lost the object: the rest are failures
        std::cerr << args[1] << ", frame " << i << ": " << e.what() << "\n";
        break;
      }
    }
  }
  if (done == 0 || steps == 0) {
    return 1; // what went wrong has been said
  }
  seconds.resize(done);
  double total = 0;
  for (double s : seconds) {
    total += s;
  }
  std::sort(seconds.begin(), seconds.end());
  std::cout << "{\"tracker\": \"" << args[3] << "\", \"program\": \"ViSP " << VISP_VERSION_MAJOR << "."
            << VISP_VERSION_MINOR << " " << args[1] << " " << args[2] << "\", \"frames\": " << done << ", \"iterations\": " << steps / done
            << ", \"us_per_iteration\": " << 1e6 * total / steps << ", \"us_per_frame\": " << 1e6 * total / done
            << ", \"us_median\": " << 1e6 * quantile(seconds, 0.5) << ", \"us_p95\": " << 1e6 * quantile(seconds, 0.95)
            << ", \"fps\": " << done / total << ", \"sr_5\": " << double(good) / updates << "}\n";
  return 0;
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
