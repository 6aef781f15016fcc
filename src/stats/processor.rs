//! Processor time, which other work on the machine disturbs less than it does the clock.

use std::time::Duration;

/// What all threads of this process have used so far; `None` where the system does not tell.
pub fn process_time() -> Option<Duration> {
    time(ProcessorClock::Process)
}

/// What the workers of the current pool have used since they were started. Each is asked when it has nothing else to do.
pub fn workers_time() -> Option<Duration> {
    rayon::broadcast(|_| time(ProcessorClock::Thread)).into_iter().sum()
}

enum ProcessorClock {
    Process,
    Thread,
}

#[cfg(unix)]
fn time(clock: ProcessorClock) -> Option<Duration> {
    let clock = match clock {
        ProcessorClock::Process => libc::CLOCK_PROCESS_CPUTIME_ID,
        ProcessorClock::Thread => libc::CLOCK_THREAD_CPUTIME_ID,
    };
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: the call writes to `time` alone.
    let told = unsafe { libc::clock_gettime(clock, &raw mut time) } == 0;
    let seconds = u64::try_from(time.tv_sec).ok().filter(|_| told)?;
    Some(Duration::new(seconds, u32::try_from(time.tv_nsec).ok()?))
}

#[cfg(not(unix))]
fn time(_: ProcessorClock) -> Option<Duration> {
    None
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::time::Instant;

    #[test]
    fn work_takes_processor_time_and_sleep_does_not() {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let used = |work: fn()| {
            let before = pool.install(workers_time).unwrap();
            pool.install(work);
            pool.install(workers_time).unwrap() - before
        };
        let busy = used(|| {
            let started = Instant::now();
            while started.elapsed() < Duration::from_millis(30) {
                std::hint::spin_loop();
            }
        });
        let asleep = used(|| std::thread::sleep(Duration::from_millis(30)));
        assert!(busy > 2 * asleep, "{busy:?} of work, {asleep:?} of sleep");
        assert!(process_time().unwrap() >= busy);
    }
}
