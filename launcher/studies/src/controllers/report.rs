//! The study as a table and files.

use super::{Row, Study};
use figures::results::{ResultsError, ResultsFolder, Table};
use serde_json::{Value, json};

/// One row per pair. Times of a step are over those of the first row, the MPCs.
#[must_use]
pub fn table(study: &Study) -> Table {
    let mut table = Table::new([
        "position",
        "attitude",
        "rms mm",
        "max mm",
        "push m",
        "back s",
        "roll s",
        "yaw s",
        "peak rad",
        "pulse rad",
        "back s",
        "outside",
        "clipped %",
        "lost",
        "att. time",
        "pos. time",
    ]);
    for row in &study.rows {
        let [attitude, position] = ratios(study, row);
        table.push([
            row.pair.position.to_owned(),
            row.pair.attitude.to_owned(),
            format!("{:.1}", row.rms_m * 1e3),
            format!("{:.1}", row.max_m * 1e3),
            format!("{:.2}", row.push_m),
            seconds(row.push_recovery_s),
            seconds(row.settling_s[0]),
            seconds(row.settling_s[1]),
            format!("{:.3}", row.peak_rad),
            format!("{:.3}", row.pulse_rad),
            seconds(row.pulse_recovery_s),
            row.violations.to_string(),
            format!("{:.2}", row.clipped_share * 100.0),
            row.lost.to_string(),
            format!("{attitude:.2}"),
            format!("{position:.2}"),
        ]);
    }
    table
}

fn seconds(time_s: Option<f64>) -> String {
    time_s.map_or("never".to_owned(), |time_s| format!("{time_s:.2}"))
}

/// Median time of a step over that of the first row.
fn ratios(study: &Study, row: &Row) -> [f64; 2] {
    let first = study.rows.first().map_or([1, 1], |first| first.step_ns);
    [0, 1].map(|slot| row.step_ns[slot] as f64 / first[slot].max(1) as f64)
}

/// Every number, for machines.
#[must_use]
pub fn to_json(study: &Study) -> Value {
    let row = |row: &Row| {
        let [attitude, position] = ratios(study, row);
        json!({
            "position": row.pair.position,
            "attitude": row.pair.attitude,
            "rms_m": row.rms_m,
            "max_m": row.max_m,
            "push_m": row.push_m,
            "push_recovery_s": row.push_recovery_s,
            "tilt_settling_s": row.settling_s[0],
            "yaw_settling_s": row.settling_s[1],
            "peak_rad": row.peak_rad,
            "pulse_rad": row.pulse_rad,
            "pulse_recovery_s": row.pulse_recovery_s,
            "violations": row.violations,
            "clipped_share": row.clipped_share,
            "lost": row.lost,
            "attitude_time_ratio": attitude,
            "position_time_ratio": position,
        })
    };
    json!({
        "seeds": study.plan.seeds,
        "sizes_deg": study.plan.sizes_deg,
        "pairs": study.rows.iter().map(row).collect::<Vec<_>>(),
    })
}

/// Writes table and JSON.
///
/// # Errors
/// A file that cannot be written.
pub fn write(study: &Study, folder: &mut ResultsFolder) -> Result<(), ResultsError> {
    folder.table("controllers", &table(study))?;
    folder.json("controllers", &to_json(study))
}
