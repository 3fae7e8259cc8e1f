//! Which user has the other end of a connection within this machine, by the system's own table.

use core::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::fs;

/// User of the process that has the end `there` of a connection from `here`; none if it is not on this
/// machine, or not in this network namespace.
pub(super) fn user_of(here: SocketAddr, there: SocketAddr) -> Option<u32> {
    let tables = ["/proc/self/net/tcp", "/proc/self/net/tcp6"];
    tables.into_iter().find_map(|table| user_in(&fs::read_to_string(table).ok()?, here, there))
}

/// As [`user_of`], in the text of one table (`proc_net_tcp(5)`). One address may be of several connections, and those
/// that have ended count as root's.
fn user_in(table: &str, here: SocketAddr, there: SocketAddr) -> Option<u32> {
    const ESTABLISHED: &str = "01";
    let wanted = [there, here].map(|end| (end.ip().to_canonical(), end.port()));
    table.lines().skip(1).find_map(|line| {
        let columns: Vec<&str> = line.split_whitespace().take(8).collect();
        let [_, local, remote, state, _, _, _, user] = columns[..] else { return None };
        let is_wanted = [address(local)?, address(remote)?] == wanted && state == ESTABLISHED;
        is_wanted.then(|| user.parse().ok())?
    })
}

/// Address and port in hexadecimal: the words of an address as this machine keeps them, the port as a number.
fn address(text: &str) -> Option<(IpAddr, u16)> {
    let (address, port) = text.split_once(':')?;
    let word =
        |at: usize| Some(u32::from_str_radix(address.get(at..at + 8)?, 16).ok()?.to_ne_bytes());
    let ip = match address.len() {
        8 => Ipv4Addr::from(word(0)?).into(),
        32 => {
            let words = [word(0)?, word(8)?, word(16)?, word(24)?];
            let bytes: [u8; 16] = words.concat().try_into().ok()?;
            IpAddr::from(Ipv6Addr::from(bytes)).to_canonical()
        }
        _ => return None,
    };
    Some((ip, u16::from_str_radix(port, 16).ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::{TcpListener, TcpStream};

    #[test]
    fn a_connection_within_this_machine_is_of_the_user_who_made_it() {
        for address in ["127.0.0.1:0", "[::1]:0"] {
            let Ok(listener) = TcpListener::bind(address) else { continue };
            let here = listener.local_addr().unwrap();
            let stream = TcpStream::connect(here).unwrap();
            let (_held, there) = listener.accept().unwrap();
            let own = rustix::process::geteuid().as_raw();
            assert_eq!(user_of(here, there), Some(own), "{address}");
            // Kept for documentation (RFC 5737).
            assert_eq!(user_of("192.0.2.1:9".parse().unwrap(), there), None);
            drop(stream);
        }
    }

    #[cfg(target_endian = "little")]
    #[test]
    fn only_the_connection_itself_counts_whichever_others_have_its_address() {
        let ends = |local: &str, remote: &str| format!("{local}:C350 {remote}:1F90");
        let line = |ends: &str, state: &str, user: u32| {
            format!("0: {ends} {state} 00000000:00000000 00:00000000 00000000 {user} 0 4711 1 0\n")
        };
        let (four, six) = ("0100007F", "0000000000000000FFFF00000100007F");
        let other = "0100007F:C350 0100007F:0050";
        // What is left of an earlier connection, one to another port, the one in question.
        let table =
            ["head\n".to_owned(), line(&ends(four, four), "06", 0), line(other, "01", 1000)];
        let (here, there) = ("127.0.0.1:8080".parse().unwrap(), "127.0.0.1:50000".parse().unwrap());
        assert_eq!(user_in(&table.concat(), here, there), None);
        for ip in [four, six] {
            let table = [table.concat(), line(&ends(ip, ip), "01", 1001)].concat();
            assert_eq!(user_in(&table, here, there), Some(1001), "{ip}");
        }
    }
}
