//! What the harness makes of tests whose needs are not met.

use crate::harness::{Need, missing, required};

crate::tests! {
    what_is_missing_is_ignored_with_the_reason_or_refused;
    the_list_of_requirements_is_read_with_care;
}

fn what_is_missing_is_ignored_with_the_reason_or_refused() {
    let only_slow = |n: Need| n == Need::Slow;
    let reason = |needs: &[Need], words: &[&str]| missing(needs, &only_slow, words);
    assert_eq!(reason(&[], &[]), Ok(None));
    assert_eq!(reason(&[Need::Slow], &["slow"]), Ok(None));
    let shared = "needs shared data (MTF_EVAL_SHARED)";
    assert_eq!(
        reason(&[Need::Slow, Need::Shared], &["slow"]),
        Ok(Some(shared.to_owned()))
    );
    let refused = format!("{shared}, and MTF_EVAL_REQUIRE names shared");
    assert_eq!(reason(&[Need::Shared], &["slow", "shared"]), Err(refused));
}

fn the_list_of_requirements_is_read_with_care() {
    assert_eq!(required(""), Ok(vec![]));
    assert_eq!(required("shared, slurm,"), Ok(vec!["shared", "slurm"]));
    assert!(required("all").unwrap().contains(&"valgrind"));
    assert!(required("shard").unwrap_err().contains("unknown need 'shard'"));
}
