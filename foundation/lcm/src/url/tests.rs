use super::*;

fn parsed(text: &str) -> Url {
    let (url, warnings) = Url::parse(text).expect(text);
    assert_eq!(warnings, [], "{text}");
    url
}

fn udpm(text: &str) -> Udpm {
    match parsed(text) {
        Url::Udpm(url) => url,
        other => panic!("{other}"),
    }
}

#[test]
fn what_is_left_out_has_lcms_default() {
    let default = udpm("udpm://239.255.76.67:7667?ttl=0");
    for text in ["", "udpm://", "udpm://?", "udpm://239.255.76.67", "udpm://:7667", "udpm://?recv_buf_size=0"] {
        assert_eq!(udpm(text), default, "{text}");
    }
    assert_eq!(default, Udpm::default());
    assert_eq!(udpm("udpm://224.1.2.3"), Udpm { group: Ipv4Addr::new(224, 1, 2, 3), ..default });
    assert_eq!(parsed("tcpq://"), Url::Tcpq(SocketAddrV4::new(Ipv4Addr::LOCALHOST, 7700)));
    let play = Mode::Play { speed: 1.0, start: None };
    assert_eq!(parsed("file://a.lcmlog"), Url::File(File { path: "a.lcmlog".into(), mode: play }));
}

#[test]
fn options_are_read_and_a_later_one_wins() {
    let url = udpm("udpm://239.1.2.3:1?ttl=1&recv_buf_size=0x10000&shm=auto?ttl=255&");
    let group = Ipv4Addr::new(239, 1, 2, 3);
    let wanted = Udpm { group, port: 1, ttl: 255, recv_buf_size: 65536, interface: None, shm: Shm::Auto };
    assert_eq!(url, wanted);
    assert_eq!(udpm("udpm://?interface=eth0").interface, Some(Interface::Name("eth0".into())));
    let address = Some(Interface::Address(Ipv4Addr::LOCALHOST));
    assert_eq!(udpm("udpm://?interface=127.0.0.1").interface, address);
    let play = Mode::Play { speed: 0.5, start: Some(-3) };
    let wanted = Url::File(File { path: "/tmp/a".into(), mode: play });
    assert_eq!(parsed("file:///tmp/a?mode=r&speed=0.5&start_timestamp=-3"), wanted);
}

#[test]
fn what_is_written_reads_the_same() {
    for text in [
        "udpm://239.255.76.67:7667?ttl=0",
        "udpm://239.1.2.3:1?ttl=255&recv_buf_size=65536&interface=eth0&shm=auto",
        "tcpq://10.0.0.1:7701",
        "memq://",
        "file:///tmp/a?speed=0.5&start_timestamp=7",
        "file://a?mode=w",
        "file://a?mode=a",
    ] {
        assert_eq!(parsed(text).to_string(), text);
    }
}

#[test]
fn an_unknown_option_is_a_warning() {
    let (url, warnings) = Url::parse("udpm://?TTL=1&transmit_only=true&flag").unwrap();
    assert_eq!(url, Url::default());
    let unknown = |option: &str, known| Warning::Unknown { option: option.into(), known };
    let known = "ttl, recv_buf_size, interface, shm";
    assert_eq!(warnings, [unknown("TTL=1", known), Warning::Obsolete("transmit_only".into()), unknown("flag", known)]);
    let (_, warnings) = Url::parse("memq://?ttl=0").unwrap();
    assert_eq!(warnings[0].to_string(), "LCM URL: unknown option `ttl=0` ignored; this provider has none");
}

#[test]
fn a_wrong_url_is_one_clear_line() {
    let group = |name| format!("LCM URL: `{name}` is not an IPv4 multicast address (224.0.0.0 to 239.255.255.255)");
    for (text, line) in [
        ("udpm:/", "LCM URL `udpm:/`: starts with none of udpm://, tcpq://, memq://, file://"),
        ("mpudpm://", "LCM URL `mpudpm://`: starts with none of udpm://, tcpq://, memq://, file://"),
        ("udpm://10.0.0.1:7667", &group("10.0.0.1")),
        ("udpm://robot", &group("robot")),
        ("udpm://239.1.1.1:0", "LCM URL: port `0` is not within 1 to 65535"),
        ("udpm://239.1.1.1:", "LCM URL: port `` is not within 1 to 65535"),
        ("udpm://239.1.1.1:65536", "LCM URL: port `65536` is not within 1 to 65535"),
        ("udpm://?ttl=256", "LCM URL: ttl=`256`; allowed is 0 to 255"),
        ("udpm://?ttl", "LCM URL: ttl=``; allowed is 0 to 255"),
        ("udpm://?ttl=+1", "LCM URL: ttl=`+1`; allowed is 0 to 255"),
        ("udpm://?ttl=010", "LCM URL: ttl=`010`; allowed is 0 to 255"),
        ("udpm://?recv_buf_size=-1", "LCM URL: recv_buf_size=`-1`; allowed is 0 to 1073741823"),
        ("udpm://?shm=on", "LCM URL: shm=`on`; allowed is off, auto or a user id"),
        ("udpm://?interface=", "LCM URL: interface=``; allowed is the name of a network interface or its IPv4 address"),
        ("tcpq://robot", "LCM URL: `robot` is not an IPv4 address; names are not resolved"),
        ("memq://x", "LCM URL: `x` where nothing must stand"),
        ("file://", "LCM URL: `` where the path of an event log must stand"),
        ("file://a?mode=x", "LCM URL: mode=`x`; allowed is r, w or a"),
        ("file://a?speed=NaN", "LCM URL: speed=`NaN`; allowed is a number"),
    ] {
        assert_eq!(Url::parse(text).unwrap_err().to_string(), line, "{text}");
    }
}
