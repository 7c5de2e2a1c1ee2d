//! Protocols that start trackers anew, and several protocols in one run.

use super::*;
use crate::metric::aggregate::{Average, SequenceRow};
use crate::store::journal::Entry;

fn protocols(text: &str) -> Protocols {
    text.parse().unwrap()
}

/// Fields of the lines of a log.
fn log(request: &RunRequest, bench: &Bench, tracker: &str, name: &str) -> Vec<Vec<String>> {
    let folder = request.out.join("frames").join(tracker);
    let path = folder.join(bench.sequences[0].dataset()).join(name);
    let text = fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let fields = |line: &str| line.split(',').map(str::to_owned).collect();
    text.lines().skip(1).map(fields).collect()
}

/// The statuses of a log, one letter each: `i`nit, `f`ailed, `s`kipped, `b`roken, `.` tracked.
fn letters(log: &[Vec<String>]) -> String {
    let letter = |row: &Vec<String>| match row[2].as_str() {
        "init" => 'i',
        "failed" => 'f',
        "skipped" => 's',
        "broken" => 'b',
        _ => '.',
    };
    log.iter().map(letter).collect()
}

fn row<'a>(report: &'a RunReport, tracker: &str, sequence: &str, protocol: &str) -> &'a SequenceRow {
    let mut rows = report.results.sequences.iter();
    rows.find(|r| r.tracker.id == tracker && r.sequence == sequence && r.protocol == protocol)
        .unwrap()
}

#[test]
fn failures_of_every_kind_end_a_stretch() {
    let bench = Bench::new(&[30, 25]);
    let kinds = [
        ("errs", Trick::Lose { at: 4 }),
        ("infinite", Trick::Infinite { at: 4 }),
        ("jumps", Trick::Jump { at: 4 }),
        ("panics", Trick::Panic { at: 4 }),
        ("steady", Trick::Nothing),
    ];
    let trackers = kinds.map(|(id, trick)| tracker(id, trick, 1)).to_vec();
    let mut request = bench.request("out", trackers);
    request.protocol = protocols("reinit");
    let report = go(&request).unwrap();
    assert_eq!(report.failed, []);
    for (id, _) in &kinds[..4] {
        let long = log(&request, &bench, id, "seq0@reinit-20-5.csv");
        assert_eq!(letters(&long), "i...fssssi...fssssi...fssssi..", "{id}");
        // Fewer than 5 frames are left after the last failure.
        let short = log(&request, &bench, id, "seq1@reinit-20-5.csv");
        assert_eq!(letters(&short), "i...fssssi...fssssi...fss", "{id}");
        let score = row(&report, id, "seq0", "reinit:20:5").score.clone();
        assert_eq!((score.frames(), score.failures()), (11 + 3, 3), "{id}");
        assert_eq!(score["frames_per_failure"], 3.5, "{id}");
        assert_eq!(score["sr_20"], 0.785714, "{id}");
        // What was tracked was never far off: failures have no part in it.
        assert!(
            score["al_mean"] < 3.0 && score["al_mean"] == score["al_tracked"],
            "{id}: {score:?}"
        );
    }
    // The error that made it a failure is in the log.
    let long = log(&request, &bench, "jumps", "seq0@reinit-20-5.csv");
    assert!(long[4][11].parse::<f64>().unwrap() > 20.0, "{:?}", long[4]);
    assert_eq!(long[9][11], "", "{:?}", long[9]);
    let steady = row(&report, "steady", "seq0", "reinit:20:5").score.clone();
    assert_eq!(
        (steady.frames(), steady.failures(), steady["frames_per_failure"]),
        (29, 0, 29.0)
    );
    let pooled = |id: &str| {
        let mut rows = report.results.summary.iter();
        rows.find(|r| r.tracker.id == id && r.average == Average::Pooled)
            .unwrap()
    };
    assert_eq!(pooled("jumps").score.failures(), 6);
    assert_eq!(
        pooled("jumps").score["frames_per_failure"],
        round6((14.0 + 12.0) / 7.0)
    );
    assert_eq!((pooled("jumps").runs, pooled("jumps").failed_runs), (2, 0));

    let before = files(&request.out);
    assert_eq!(go(&request).unwrap().resumed, 10);
    assert_eq!(files(&request.out), before);
    request.out = bench.dir.path().join("no_logs");
    request.frame_logs = FrameLogs::None;
    let without = go(&request).unwrap();
    assert_eq!(format!("{:?}", without.results), format!("{:?}", report.results));
}

fn round6(x: f64) -> f64 {
    (x * 1e6).round() / 1e6
}

#[test]
fn thresholds_skips_and_refused_starts() {
    let bench = Bench::new(&[30]);
    let trackers = vec![
        tracker("drifts", Trick::Nothing, 1),
        tracker("jumps", Trick::Jump { at: 4 }, 1),
        tracker("no_start", Trick::NoStart, 1),
        tracker("refuses", Trick::Refuse { frame: 7 }, 1),
    ];
    let mut request = bench.request("out", trackers);
    request.protocol = protocols("reinit:1.5:3,reinit:1e3:1");
    let report = go(&request).unwrap();
    // A tracker that cannot start at all fails its unit, under any protocol.
    let failed: Vec<&str> = report.failed.iter().map(|(unit, _)| unit.as_str()).collect();
    let dataset = bench.sequences[0].dataset();
    assert_eq!(
        failed,
        ["1.5:3", "1000:1"].map(|p| format!("no_start on {dataset}/seq0 (reinit:{p})"))
    );
    let lost = row(&report, "no_start", "seq0", "reinit:1.5:3");
    assert_eq!(
        (lost.score.frames(), lost.score.failures(), lost.score["auc"]),
        (29, 29, 0.0)
    );
    // Nothing is above 1000 px.
    let jumps = row(&report, "jumps", "seq0", "reinit:1000:1").score.clone();
    assert_eq!(
        (jumps.frames(), jumps.failures(), jumps["sr_20"]),
        (29, 0, 0.103448)
    );
    assert_eq!(jumps["al_mean"], round6(jumps["al_mean"]));
    assert!(jumps["al_mean"] > 10.0);
    // Errors grow until they are above 1.5 px; the next start is 3 frames later.
    let log = log(&request, &bench, "drifts", "seq0@reinit-1.5-3.csv");
    let letters = letters(&log);
    let al = |i: usize| log[i][11].parse::<f64>().unwrap();
    for (i, letter) in letters.char_indices() {
        match letter {
            'f' => assert!(
                al(i) > 1.5 && letters[i + 1..].starts_with(&"ssi"[..(29 - i).min(3)]),
                "{letters}"
            ),
            '.' => assert!(al(i) <= 1.5),
            _ => {}
        }
    }
    assert!(letters.contains('f'), "{letters}");
    // A start that is refused is a failure, too. This one is about to start on frame 7 if it failed on frame 4.
    let bench = Bench::new(&[12]);
    let mut request = bench.request("refused", vec![tracker("refuses", Trick::Refuse { frame: 3 }, 1)]);
    request.protocol = protocols("every:3,reinit:0.01:2");
    let report = go(&request).unwrap();
    assert_eq!(report.failed, []);
    let rows = super::protocols::log(&request, &bench, "refuses", "seq0@reinit-0.01-2.csv");
    assert_eq!(super::protocols::letters(&rows), "ifsfsifsifss");
    let rows = super::protocols::log(&request, &bench, "refuses", "seq0@every-3.csv");
    assert_eq!(super::protocols::letters(&rows), "i...bbb.....");
    let every = row(&report, "refuses", "seq0", "every:3").score.clone();
    assert_eq!((every.frames(), every.failures()), (11, 3));
}

#[test]
fn what_follows_a_start_does_not_depend_on_what_came_before() {
    let bench = Bench::new(&[29]);
    let trackers = vec![
        tracker("jumps", Trick::Jump { at: 4 }, 1),
        tracker("panics", Trick::Panic { at: 3 }, 1),
        tracker("still", Trick::Nothing, 1),
    ];
    let mut request = bench.request("out", trackers);
    request.protocol = protocols("every:7,ope,reinit:20:3,subseq:4");
    let before = bench.sequences[0].decoded_count();
    let report = go(&request).unwrap();
    assert_eq!(bench.sequences[0].decoded_count() - before, 29);
    // One pass from frame 0 is both one-pass evaluation and a sub-sequence: 4 starts, every and reinit.
    assert_eq!((report.units, report.results.sequences.len()), (18, 21));
    let journal = fs::read_to_string(request.out.join("journal.jsonl")).unwrap();
    let courses: Vec<Option<String>> = journal
        .lines()
        .map(|l| serde_json::from_str::<Entry>(l).unwrap().course)
        .collect();
    assert_eq!(courses.iter().filter(|c| c.is_none()).count(), 12);

    let corners = |log: &[Vec<String>], frame: &str| {
        let row = log.iter().find(|row| row[0] == frame).unwrap();
        row[3..15].to_vec()
    };
    for start in [7, 14, 21] {
        let pass = log(&request, &bench, "still", &format!("seq0@{start}.csv"));
        let every = log(&request, &bench, "still", "seq0@every-7.csv");
        for frame in start + 1..=start + 7 {
            let frame = frame.to_string();
            assert_eq!(
                corners(&pass, &frame),
                corners(&every, &frame),
                "{start}: {frame}"
            );
        }
    }
    // Failures in frames 4, 11, ... and starts in 7, 14, ...
    let reinit = log(&request, &bench, "jumps", "seq0@reinit-20-3.csv");
    assert_eq!(letters(&reinit), "i...fssi...fssi...fssi...fsss");
    let pass = log(&request, &bench, "jumps", "seq0@7.csv");
    for frame in ["8", "9", "10", "11"] {
        assert_eq!(corners(&pass, frame), corners(&reinit, frame));
    }

    // A panic fails a pass; started anew, the tracker has no output until the next start.
    let failed = |r: &&SequenceRow| r.status.is_failed();
    assert_eq!(report.results.sequences.iter().filter(failed).count(), 5);
    let every = log(&request, &bench, "panics", "seq0@every-7.csv");
    assert_eq!(letters(&every), "i..bbbbb..bbbbb..bbbbb..bbbbb");
    let score = row(&report, "panics", "seq0", "every:7").score.clone();
    assert_eq!((score.frames(), score.failures()), (28, 20));
    assert!(score["frames_per_failure"].is_nan());
    let still = |protocol: &str| row(&report, "still", "seq0", protocol).score.clone();
    assert_eq!(still("every:7").frames(), still("ope").frames());
    assert!(still("every:7")["al_mean"] < still("ope")["al_mean"]);

    // Each protocol alone has the same figures.
    for protocol in ["ope", "subseq:4", "every:7", "reinit:20:3"] {
        let mut alone = request.clone();
        alone.protocol = protocols(protocol);
        alone.out = bench.dir.path().join(protocol.replace(':', "_"));
        let alone = go(&alone).unwrap();
        let own = |r: &&SequenceRow| r.protocol == protocol;
        let rows: Vec<&SequenceRow> = report.results.sequences.iter().filter(own).collect();
        assert_eq!(
            format!("{:?}", alone.results.sequences.iter().collect::<Vec<_>>()),
            format!("{rows:?}")
        );
    }
}

#[test]
fn frames_without_ground_truth_are_not_started_on() {
    let bench = Bench::new(&[30]);
    let root = bench.dir.path().join("data");
    let text = fs::read_to_string(root.join("seq0.txt")).unwrap();
    // Annotated: 0 to 4, then 12 to 29 but 20.
    let truth = |(line, text): (usize, &str)| match line.checked_sub(1) {
        Some(5..=11 | 20) => format!("{} unannotated\n", text.split(' ').next().unwrap()),
        _ => format!("{text}\n"),
    };
    let text: String = text.lines().enumerate().map(truth).collect();
    fs::write(root.join("seq0.txt"), text).unwrap();
    let options = LoadOptions {
        on_bad_data: dataset::OnBadData::Fail,
        ..LoadOptions::default()
    };
    let sequences = dataset::load(&root, &options).unwrap().sequences;
    assert_eq!(sequences[0].annotated(), 22);
    let mut request = bench.request(
        "out",
        vec![
            tracker("errs", Trick::Lose { at: 8 }, 1),
            tracker("jumps", Trick::Jump { at: 4 }, 1),
        ],
    );
    request.sequences = sequences;
    request.protocol = protocols("reinit,every:20");
    let report = go(&request).unwrap();
    let jumps = log(&request, &bench, "jumps", "seq0@reinit-20-5.csv");
    assert_eq!(letters(&jumps), "i...fsssssssi...fssssi...fssss");
    // An error is a failure with or without ground truth: that of frame 8 counts as an evaluated frame.
    let errs = log(&request, &bench, "errs", "seq0@reinit-20-5.csv");
    assert_eq!(letters(&errs), "i.......fssssi.......fssssi...");
    let score = row(&report, "errs", "seq0", "reinit:20:5").score.clone();
    assert_eq!((score.frames(), score.failures()), (4 + 1 + 6 + 1 + 3, 2));
    // Every 20 frames is frame 21 here; the one before is tracked from frame 0.
    let every = row(&report, "jumps", "seq0", "every:20").score.clone();
    assert_eq!((every.frames(), every.failures()), (21, 1 + 9 + 5));
}

/// The tracker of the tests moves by its seed's last three digits: each start, the first and those after failures, has the
/// seed of its tracker, data set, sequence and frame.
#[test]
fn every_start_has_a_seed_of_its_own() {
    let bench = Bench::new(&[30, 25]);
    let mut request = bench.request("out", vec![tracker("jumps", Trick::Jump { at: 4 }, 1)]);
    request.protocol = protocols("reinit");
    go(&request).unwrap();
    let mut starts = 0;
    for sequence in ["seq0", "seq1"] {
        let log = log(&request, &bench, "jumps", &format!("{sequence}@reinit-20-5.csv"));
        let x = |i: usize| log[i][3].parse::<f64>().unwrap();
        for i in (0..log.len()).filter(|&i| log[i][2] == "init") {
            let names = ["jumps", bench.sequences[0].dataset(), sequence];
            let seed = crate::plan::derived_seed(7, &names, Some(i as u64));
            let offset = (seed % 1000) as f64 / 1000.0;
            assert!((x(i + 2) - x(i + 1) - offset).abs() < 1e-6, "{sequence} {i}");
            starts += 1;
        }
    }
    assert_eq!(starts, 7);
}
