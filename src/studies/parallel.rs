//! Independent runs on two threads; results in order, so that tables do not depend on timing.

use std::sync::atomic::{AtomicUsize, Ordering};

const THREADS: usize = 2;

/// `work(0)`, `work(1)` … `work(count - 1)`, in this order.
pub fn for_each_index<T: Send>(count: usize, work: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let next = AtomicUsize::new(0);
    let take_turns = || {
        let indices = std::iter::repeat_with(|| next.fetch_add(1, Ordering::Relaxed));
        let own = indices.take_while(|&index| index < count);
        own.map(|index| (index, work(index))).collect::<Vec<_>>()
    };
    let mut results = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..THREADS.min(count)).map(|_| scope.spawn(take_turns)).collect();
        let joined = threads.into_iter().map(|thread| thread.join());
        joined
            .flat_map(|own| own.unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
            .collect::<Vec<_>>()
    });
    results.sort_by_key(|&(index, _)| index);
    results.into_iter().map(|(_, result)| result).collect()
}

#[cfg(test)]
mod tests {
    use super::for_each_index;

    #[test]
    fn prop_results_are_complete_and_in_order() {
        assert_eq!(
            for_each_index(100, |i| i * i),
            (0..100).map(|i| i * i).collect::<Vec<_>>()
        );
        assert!(for_each_index(0, |i| i).is_empty());
    }
}
