//! Ctrl-C, in a process of its own: the request is global.
#![cfg(unix)]

use signal_hook::consts::SIGINT;
use signal_hook::low_level::raise;
use std::process::Command;
use surflux::error::Error;
use surflux::interrupt;

/// Set in the child that the test below starts.
const CHILD: &str = "SURFLUX_TEST_INTERRUPT_CHILD";

#[test]
fn first_interrupt_is_a_request_and_the_second_ends_the_process() {
    if std::env::var_os(CHILD).is_some() {
        return be_interrupted_twice();
    }
    let itself = std::env::current_exe().unwrap();
    let status = Command::new(itself).env(CHILD, "1").output().unwrap().status;
    assert_eq!(status.code(), Some(130));
}

fn be_interrupted_twice() {
    interrupt::install();
    interrupt::install();
    assert!(interrupt::check().is_ok());
    raise(SIGINT).expect("a process can signal itself");
    assert!(matches!(interrupt::check(), Err(Error::Interrupted)));
    raise(SIGINT).expect("a process can signal itself");
    unreachable!("the second interrupt must not return");
}
