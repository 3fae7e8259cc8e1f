//! The same work on many items, on all cores.

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread::{self, Builder};

/// Called after each item, from whatever thread.
pub type Progress<'a> = &'a (dyn Fn() + Sync);

/// `work` on every item, on as many threads as there are processors; results in the order of the
/// items, whatever the order of the work.
///
/// # Errors
/// The error of the first item, in their order, among those worked on; no item is begun after one.
pub fn fan_out<I: Sync, R: Send, E: Send>(
    items: &[I],
    progress: Progress<'_>,
    work: impl Fn(&I) -> Result<R, E> + Sync,
) -> Result<Vec<R>, E> {
    let next = AtomicUsize::new(0);
    let results: Vec<Mutex<Option<Result<R, E>>>> =
        items.iter().map(|_| Mutex::new(None)).collect();
    let worker = || {
        loop {
            let index = next.fetch_add(1, Ordering::Relaxed);
            let Some(item) = items.get(index) else { return };
            let result = work(item);
            if result.is_err() {
                next.store(items.len(), Ordering::Relaxed);
            }
            if let Ok(mut slot) = results[index].lock() {
                *slot = Some(result);
            }
            progress();
        }
    };
    let threads = thread::available_parallelism().map_or(1, usize::from).min(items.len());
    thread::scope(|scope| {
        let begun = (0..threads).map(|_| Builder::new().spawn_scoped(scope, worker));
        // Where no thread can be had, this one does the work.
        if begun.flatten().count() == 0 {
            worker();
        }
    });
    // An item without a result comes after one with an error, which ends the collection.
    results.into_iter().filter_map(|slot| slot.into_inner().ok().flatten()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_come_in_the_order_of_the_items_and_each_is_reported() {
        let done = AtomicUsize::new(0);
        let items: Vec<u64> = (0..500).collect();
        let count = || {
            done.fetch_add(1, Ordering::Relaxed);
        };
        let squares = fan_out(&items, &count, |i| Ok::<_, ()>(i * i)).unwrap();
        assert_eq!(squares, items.iter().map(|i| i * i).collect::<Vec<_>>());
        assert_eq!(done.into_inner(), 500);
    }

    #[test]
    fn an_error_ends_the_work_and_is_returned() {
        let items: Vec<u64> = (0..100_000).collect();
        let worked = AtomicUsize::new(0);
        let result = fan_out(&items, &|| (), |&i| {
            worked.fetch_add(1, Ordering::Relaxed);
            if i == 3 { Err("three") } else { Ok(i) }
        });
        assert_eq!(result, Err("three"));
        assert!(worked.into_inner() < items.len());
    }
}
