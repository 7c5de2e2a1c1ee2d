//! stand-in
use crate::eval::aggregate::Results;
/// stand-in
#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    /// io
    #[error("{0}")]
    Io(#[from] std::io::Error),
}
/// stand-in
pub fn write_results(dir: &std::path::Path, results: &Results) -> Result<(), OutputError> {
    let mut out = "tracker,sm,am,ssm,ilm,dataset,sequence,start,protocol,status,frames,al_mean\n".to_string();
    for u in &results.units {
        let sum: f64 = u.errors.iter().flatten().map(|e| e.al).sum();
        out += &format!(
            "{},{},{},{},{},{},{},{},{},{:?},{},{}\n",
            u.tracker.id,
            u.tracker.sm,
            u.tracker.am,
            u.tracker.ssm,
            u.tracker.ilm,
            u.dataset,
            u.sequence,
            u.start,
            u.protocol,
            u.status,
            u.errors.len(),
            sum
        );
    }
    std::fs::write(dir.join("sequences.csv"), &out)?;
    std::fs::write(dir.join("summary.csv"), &out)?;
    Ok(())
}
