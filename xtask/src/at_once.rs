//! Independent work, some of it at a time.

use std::sync::Mutex;

use anyhow::anyhow;

/// Does `work` for all items, some at a time; the answers stand in the order of the items.
pub fn each<I: Sync, T: Send>(
    items: &[I],
    jobs: usize,
    work: &(dyn Fn(&I) -> anyhow::Result<T> + Sync),
) -> anyhow::Result<Vec<T>> {
    let next = Mutex::new(items.iter().enumerate());
    let mut done: Vec<(usize, T)> = std::thread::scope(|scope| {
        let workers: Vec<_> = (0..jobs.max(1))
            .map(|_| {
                scope.spawn(|| -> anyhow::Result<Vec<(usize, T)>> {
                    let mut done = Vec::new();
                    loop {
                        let item = next.lock().map_err(|_| anyhow!("other work failed"))?.next();
                        let Some((index, item)) = item else { return Ok(done) };
                        done.push((index, work(item)?));
                    }
                })
            })
            .collect();
        let mut done = Vec::new();
        for worker in workers {
            done.extend(worker.join().map_err(|_| anyhow!("work failed"))??);
        }
        anyhow::Ok(done)
    })?;
    done.sort_by_key(|(index, _)| *index);
    Ok(done.into_iter().map(|(_, answer)| answer).collect())
}
