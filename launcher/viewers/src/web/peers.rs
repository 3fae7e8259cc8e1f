//! Whose the other end of a connection within this machine is, by the system's own table.

use core::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::fs;

/// User whose socket has the address `peer`; none if no socket of this machine has it.
pub(super) fn user_of(peer: SocketAddr) -> Option<u32> {
    let tables = ["/proc/self/net/tcp", "/proc/self/net/tcp6"];
    tables.into_iter().find_map(|table| user_in(&fs::read_to_string(table).ok()?, peer))
}

/// As [`user_of`], in the text of one table (`proc_net_tcp(5)`).
fn user_in(table: &str, peer: SocketAddr) -> Option<u32> {
    let wanted = (peer.ip().to_canonical(), peer.port());
    table.lines().skip(1).find_map(|line| {
        let mut words = line.split_whitespace();
        let local = address(words.nth(1)?)?;
        (local == wanted).then(|| words.nth(5)?.parse().ok())?
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
        for here in ["127.0.0.1:0", "[::1]:0"] {
            let Ok(listener) = TcpListener::bind(here) else { continue };
            let stream = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
            let (_held, peer) = listener.accept().unwrap();
            assert_eq!(user_of(peer), Some(rustix::process::geteuid().as_raw()), "{here}");
            drop(stream);
        }
        // Kept for documentation (RFC 5737).
        assert_eq!(user_of("192.0.2.1:9".parse().unwrap()), None);
    }

    #[cfg(target_endian = "little")]
    #[test]
    fn a_client_that_speaks_ipv6_to_an_address_of_ipv4_is_found_too() {
        let table = "  sl  local_address remote_address st tx_queue rx_queue tr tm->when retrnsmt   uid\n   \
            0: 0000000000000000FFFF00000100007F:C350 0000000000000000FFFF00000100007F:1F90 01 \
            00000000:00000000 00:00000000 00000000  1000        0 4711 1 0 20 4 30 10 -1\n";
        assert_eq!(user_in(table, "127.0.0.1:50000".parse().unwrap()), Some(1000));
        assert_eq!(user_in(table, "127.0.0.1:8080".parse().unwrap()), None);
    }
}
