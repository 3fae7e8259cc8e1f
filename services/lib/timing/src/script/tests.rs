use super::*;
use proptest::prelude::*;

const NAME: LoopName<'_> = LoopName { role: Role::Attitude, name: "attitude-mpc" };

fn window(from_ns: u64, until_ns: u64) -> Window {
    Window { from_ns, until_ns }
}

fn entry(window: Window, effect: LoopEffect) -> LoopEntry {
    LoopEntry { role: NAME.role, name: None, window, effect }
}

fn of_loops(loops: Vec<LoopEntry>) -> Script {
    Script::new(1, loops, Vec::new())
}

fn sample(release_ns: u64) -> Header {
    Header { release_ns, ..Header::default() }
}

#[test]
fn a_stop_puts_off_what_begins_in_it_to_its_end() {
    let stop = of_loops(vec![entry(window(100, 200), LoopEffect::Stopped)]);
    let begins = [99, 100, 199, 200].map(|at_ns| stop.begins_ns(NAME, at_ns, 0));
    assert_eq!(begins, [99, 200, 200, 200]);
    let position = LoopName { role: Role::Position, name: "position-mpc" };
    assert_eq!(stop.begins_ns(position, 150, 0), 150);
}

#[test]
fn a_step_goes_on_after_each_stop_with_what_is_left_of_it() {
    let step = entry(window(0, 1000), LoopEffect::Step(Duration::Fixed(50)));
    let stops = [window(110, 200), window(190, 210), window(220, 230)];
    let stops = stops.map(|window| entry(window, LoopEffect::Stopped));
    let script = of_loops([&[step][..], &stops].concat());
    // 10 before the first stop, 10 between the two, 30 after.
    assert_eq!(script.ends_ns(NAME, 100, 0), 260);
    // Over when the stop begins.
    assert_eq!(script.ends_ns(NAME, 60, 0), 110);
    // It began after the last window.
    assert_eq!(script.ends_ns(NAME, 1000, 0), 1000);
}

#[test]
fn an_entry_is_about_all_of_a_role_or_about_one_service() {
    let stop = entry(window(0, 10), LoopEffect::Stopped);
    let other = LoopName { name: "attitude-pid", ..NAME };
    let begins = |script: Script| [NAME, other].map(|name| script.begins_ns(name, 5, 0));
    assert_eq!(begins(of_loops(vec![stop.clone()])), [10, 10]);
    let named = LoopEntry { name: Some("attitude-pid".to_owned()), ..stop };
    assert_eq!(begins(of_loops(vec![named])), [5, 10]);
}

#[test]
fn entries_of_one_kind_that_overlap_add_up() {
    let late = |ns| LoopEffect::StartLate(Duration::Fixed(ns));
    let script = of_loops(vec![entry(window(0, 10), late(3)), entry(window(5, 15), late(4))]);
    assert_eq!([4, 5, 10, 15].map(|at_ns| script.begins_ns(NAME, at_ns, 0)), [7, 12, 14, 15]);
}

#[test]
fn a_wake_up_that_is_lost_begins_nothing() {
    let late = LoopEffect::StartLate(Duration::Fixed(3));
    let script =
        of_loops(vec![entry(window(5, 10), LoopEffect::WakeMissed), entry(window(0, 20), late)]);
    let woken = [4, 5, 9, 10].map(|at_ns| script.woken_ns(NAME, at_ns, 0));
    assert_eq!(woken, [Some(7), None, None, Some(13)]);
}

#[test]
fn a_sample_is_late_lost_or_doubled_by_its_release() {
    let samples = vec![
        SampleEntry {
            topic: "imu".to_owned(),
            window: window(10, 20),
            effect: SampleEffect::Late(Duration::Fixed(7)),
        },
        SampleEntry {
            topic: "imu".to_owned(),
            window: window(15, 17),
            effect: SampleEffect::Duplicated,
        },
        SampleEntry {
            topic: "imu".to_owned(),
            window: window(16, 17),
            effect: SampleEffect::Duplicated,
        },
        SampleEntry { topic: "imu".to_owned(), window: window(18, 19), effect: SampleEffect::Lost },
        SampleEntry {
            topic: "imu".to_owned(),
            window: window(19, 20),
            effect: SampleEffect::Late(Duration::Fixed(5)),
        },
    ];
    let script = Script::new(1, Vec::new(), samples);
    let arrivals = [9, 10, 15, 16, 18, 19, 20].map(|release_ns| {
        let Arrival { delay_ns, copies } = script.arrival("imu", &sample(release_ns));
        (delay_ns, copies)
    });
    assert_eq!(arrivals, [(0, 1), (7, 1), (7, 2), (7, 3), (7, 0), (12, 1), (0, 1)]);
    assert_eq!(script.arrival("pose_fix", &sample(15)), Arrival { delay_ns: 0, copies: 1 });
}

#[test]
fn draws_depend_on_seed_entry_and_release_alone() {
    let jitter = LoopEffect::StartLate(Duration::Uniform(0, 1 << 40));
    let entries = vec![entry(window(0, 9), jitter.clone()), entry(window(9, 99), jitter)];
    let draw = |seed, at_ns, release_ns| {
        Script::new(seed, entries.clone(), Vec::new()).begins_ns(NAME, at_ns, release_ns) - at_ns
    };
    assert_eq!(draw(1, 0, 5), draw(1, 8, 5));
    assert_ne!(draw(1, 0, 5), draw(2, 0, 5), "seed");
    assert_ne!(draw(1, 0, 5), draw(1, 9, 5), "entry");
    assert_ne!(draw(1, 0, 5), draw(1, 0, 6), "release");
}

#[test]
fn a_clock_that_begins_elsewhere_moves_windows_of_loops_and_no_release() {
    let lost =
        SampleEntry { topic: "imu".to_owned(), window: window(0, 10), effect: SampleEffect::Lost };
    let stop = entry(window(0, 10), LoopEffect::Stopped);
    let script = Script::new(1, vec![stop], vec![lost]).on_clock(1000);
    assert_eq!([5, 1005].map(|at_ns| script.begins_ns(NAME, at_ns, 0)), [5, 1010]);
    assert_eq!(script.arrival("imu", &sample(5)).copies, 0);
}

#[test]
fn a_recorded_step_begins_and_takes_as_it_did_whatever_the_loop_is_ready_for() {
    let step = |begin_ns, step_ns| RecordedStep { begin_ns, step_ns };
    // Nothing is known of the release at 10.
    let steps = BTreeMap::from([(0, step(-3, 2)), (20, step(23, 5))]);
    let recorded = entry(window(0, u64::MAX), LoopEffect::Recorded(steps));
    let script = of_loops(vec![recorded]).on_clock(100);
    let begins = [(90, 0), (99, 0), (110, 10), (120, 20), (125, 20), (130, 30)];
    let begins = begins.map(|(at_ns, release_ns)| script.begins_ns(NAME, at_ns, release_ns));
    assert_eq!(begins, [97, 99, 110, 123, 125, 130]);
    assert_eq!(
        [0, 10, 20].map(|release_ns| script.ends_ns(NAME, 123, release_ns)),
        [125, 123, 128]
    );
}

proptest! {
    /// Instant by instant.
    #[test]
    fn a_step_takes_as_many_instants_outside_stops_as_it_is_long(
        stops in proptest::collection::vec((0_u64..60, 1_u64..20), 0..5),
        start_ns in 0_u64..50,
        step_ns in 0_u64..40,
    ) {
        let stops: Vec<Window> = stops.iter().map(|&(from, long)| window(from, from + long)).collect();
        let is_stopped = |at_ns: u64| stops.iter().any(|stop| stop.contains(at_ns));
        prop_assume!(!is_stopped(start_ns));
        let step = entry(window(0, 1000), LoopEffect::Step(Duration::Fixed(step_ns)));
        let stopped = stops.iter().map(|stop| entry(*stop, LoopEffect::Stopped));
        let script = of_loops([step].into_iter().chain(stopped).collect());
        let mut end_ns = start_ns;
        let mut left_ns = step_ns;
        while left_ns > 0 {
            left_ns -= u64::from(!is_stopped(end_ns));
            end_ns += 1;
        }
        prop_assert_eq!(script.ends_ns(NAME, start_ns, 0), end_ns);
    }
}

#[test]
fn a_script_that_a_process_reads_is_the_one_that_was_written_for_it() {
    let step = RecordedStep { begin_ns: -3, step_ns: 7 };
    let effects = [
        LoopEffect::StartLate(Duration::Uniform(0, 1_000)),
        LoopEffect::Step(Duration::weighted(&[(1, 0.1), (2, 0.2), (12_000_000, 0.7)])),
        LoopEffect::Recorded(BTreeMap::from([(0, step), (10_000_000, step)])),
        LoopEffect::Stopped,
        LoopEffect::WakeMissed,
    ];
    let no_end = Window { from_ns: 5, until_ns: u64::MAX };
    let mut loops: Vec<_> = effects.map(|effect| entry(window(3, 9), effect)).into();
    loops.push(LoopEntry {
        name: Some("attitude-pid".to_owned()),
        window: no_end,
        ..loops[3].clone()
    });
    let samples =
        [SampleEffect::Late(Duration::Fixed(4)), SampleEffect::Lost, SampleEffect::Duplicated];
    let samples =
        samples.map(|effect| SampleEntry { topic: "imu".to_owned(), window: no_end, effect });
    let script = Script::new(7, loops, samples.into());
    let text = toml::to_string(&script).unwrap();
    assert_eq!(toml::from_str::<Script>(&text).unwrap(), script, "{text}");
}
