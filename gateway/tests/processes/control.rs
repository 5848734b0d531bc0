//! Commands through the gateway.

use crate::support::*;
use thetabus::bus::{Bus, ControlClient, ControlServer, Subscriber};
use thetabus::messages::{Command, Description, Item, Request, Response, item_kind, response_code};

/// What the machine's identifier answers.
fn answer(request: &Request) -> Response {
    match request.name() {
        "theta_3" => {
            let mut response = Response::new(response_code::DONE, "theta_3 is held from sample 1900 on");
            (response.from_seq, response.block) = (1900, 2);
            response.items[0] = Item {
                kind: item_kind::PARAMETER,
                value: request.value().unwrap_or(f64::NAN),
                ..Item::EMPTY
            };
            response.items_len = 1;
            response
        }
        name => Response::new(response_code::REFUSED, &format!("there is no parameter {name}")),
    }
}

/// Asks on the far side while the near side serves.
fn ask(client: ControlClient, request: Request, mut serve: impl FnMut()) -> Response {
    // A client belongs to the thread that made it, so this one serves in between.
    let pending = client.begin(&request).expect("asked");
    eventually("an answer", || {
        serve();
        client.look(&pending).expect("the gateway is there")
    })
}

#[test]
fn e2e_commands_are_acknowledged_as_on_the_machines_own_host() {
    let site = Site::new();
    let mut machine = Machine::new(&site.near);
    let mut server = ControlServer::new(&machine.bus).expect("served");
    let at = endpoint();
    let out = site.out(&["--listen", &at]);
    let _inward = site.inward(&["--connect", &at]);
    let bus = Bus::join(&site.far, "arm", "reader").expect("joined");
    let mut descriptions = Subscriber::<Description>::new(&bus).expect("subscribed");
    machine.until(&mut descriptions, "the description", |_| true);
    let client = || eventually("a server of control", || ControlClient::new(&bus).ok());

    let fix = Request::new(Command::Fix).named("theta_3").with_value(0.1 + 0.2);
    let mut seen = Vec::new();
    let mut serve = |server: &mut ControlServer| {
        server
            .serve(8, |request| {
                seen.push(*request);
                answer(request)
            })
            .expect("served");
    };
    assert_eq!(ask(client(), fix, || serve(&mut server)), answer(&fix));
    let unknown = Request::new(Command::Fix).named("theta_x");
    assert_eq!(ask(client(), unknown, || serve(&mut server)), answer(&unknown));
    assert_eq!(seen, [fix, unknown], "each once, with all that it holds");

    drop(server);
    let failed = ask(client(), fix, || {});
    assert_eq!(failed.code, response_code::FAILED);
    assert!(failed.text().contains("host cell: no identifier"), "{}", failed.text());

    out.kill();
    let gone = eventually("word that the gateway is not there", || {
        let response = ask(client(), fix, || {});
        let is_it = response.text().contains("gateway of host cell is not there");
        is_it.then_some(response)
    });
    assert_eq!(gone.code, response_code::FAILED);
}

#[test]
fn fault_a_gateway_without_control_takes_no_command() {
    let site = Site::new();
    let mut machine = Machine::new(&site.near);
    let mut server = ControlServer::new(&machine.bus).expect("served");
    let at = endpoint();
    let out = site.out(&["--listen", &at, "--no-control"]);
    let _inward = site.inward(&["--connect", &at]);
    let bus = Bus::join(&site.far, "arm", "reader").expect("joined");
    let mut descriptions = Subscriber::<Description>::new(&bus).expect("subscribed");
    machine.until(&mut descriptions, "the description", |_| true);
    let client = eventually("a server of control", || ControlClient::new(&bus).ok());
    let response = ask(client, Request::new(Command::Reset), || {
        assert_eq!(
            server.serve(1, |_| Response::default()).expect("looked"),
            0,
            "nothing comes in"
        );
    });
    assert_eq!(response.code, response_code::FAILED);
    assert!(response.text().contains("takes no commands"), "{}", response.text());
    drop(out);
}
